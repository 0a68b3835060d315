"""Transforms of moving links match a direct calculation for each joint."""

import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage

from controller.broadcasters.joint_state_broadcaster import JointStates
from hal.robot_description.description import Mimic, UrdfJoint
from hal.robot_description.kinematics import child_pose
from nodes.publishing import RateLimiter
from nodes.robot_state_publisher import RobotStateParameters, RobotStatePublisher
from nodes.transforms import MovingTransforms, fixed_transforms

STAMP = Time(sec=3, nanosec=7)


def joint(name: str, kind: str, mimic: Mimic | None = None, axis: tuple[float, float, float] = (0, 0, 1)) -> UrdfJoint:
    place = ((0.1, -0.2, 0.3), (0.4, -1.1, 2.5))
    return UrdfJoint(name, kind, f"before_{name}", f"after_{name}", *place, axis, -9.0, 9.0, 1.0, mimic)


def shown(transforms: Sequence[TransformStamped]) -> dict[str, tuple[list[float], list[float]]]:
    """Return the translation and the rotation, by child frame."""
    return {
        t.child_frame_id: (
            [t.transform.translation.x, t.transform.translation.y, t.transform.translation.z],
            [t.transform.rotation.x, t.transform.rotation.y, t.transform.rotation.z, t.transform.rotation.w],
        )
        for t in transforms
    }


@pytest.mark.parametrize("kind", ["revolute", "continuous", "prismatic"])
@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (1.0, 2.0, -2.0)])
@pytest.mark.parametrize("position", [0.0, 0.7, -2.9, 5.0])
def test_moving_link_matches_the_direct_calculation(
    kind: str, axis: tuple[float, float, float], position: float
) -> None:
    moving = joint("a", kind, axis=axis)
    transforms = MovingTransforms([moving], "")
    transforms.transforms(("a",), (1.0,), STAMP)  # The messages of one cycle must not affect those of the next cycle.
    (transform,) = transforms.transforms(("a",), (position,), STAMP)
    place, turn = shown([transform])["after_a"]
    wanted_place, wanted_turn = child_pose(moving, position)
    assert place == pytest.approx(wanted_place)
    assert turn == pytest.approx(wanted_turn)
    assert math.hypot(*turn) == pytest.approx(1.0)
    assert transform.header.frame_id == "before_a"
    assert transform.header.stamp == STAMP


def test_mimic_joints_follow_unless_they_are_measured() -> None:
    moving = [joint("a", "prismatic"), joint("b", "prismatic", Mimic("a", -2.0, 0.5)), joint("c", "prismatic")]
    followed = shown(MovingTransforms(moving, "").transforms(("a",), (0.1,), STAMP))
    assert set(followed) == {"after_a", "after_b"}
    assert followed["after_b"][0] == pytest.approx(child_pose(moving[1], 0.3)[0])
    told = shown(MovingTransforms(moving, "").transforms(("a", "b"), (0.1, 0.2), STAMP))
    assert told["after_b"][0] == pytest.approx(child_pose(moving[1], 0.2)[0])


def test_unknown_positions_and_joints_are_omitted() -> None:
    transforms = MovingTransforms(
        [joint("a", "revolute"), joint("b", "revolute"), joint("f", "fixed"), joint("o", "floating")], ""
    )
    names = ("stranger", "a", "b", "f", "o")
    assert set(shown(transforms.transforms(names, (1.0, math.nan, 0.2, 0.0, 0.0), STAMP))) == {"after_b"}
    assert set(shown(transforms.transforms(names, (1.0, 0.1, 0.2, 0.0, 0.0), STAMP))) == {"after_a", "after_b"}


def test_changed_names_are_looked_up_again() -> None:
    transforms = MovingTransforms([joint("a", "prismatic"), joint("b", "prismatic")], "")
    assert set(shown(transforms.transforms(("a",), (0.1,), STAMP))) == {"after_a"}
    assert set(shown(transforms.transforms(("b",), (0.1,), STAMP))) == {"after_b"}


def test_transforms_of_several_broadcasters_are_in_one_message() -> None:
    published: list[TFMessage] = []
    publisher = cast(Any, RobotStatePublisher.__new__(RobotStatePublisher))
    publisher._parameters, publisher._stack = RobotStateParameters(), SimpleNamespace(scene=dict)
    publisher._rate_limiter, publisher._idle = RateLimiter(), RateLimiter()
    publisher._tf = SimpleNamespace(get_subscription_count=lambda: 1, publish=published.append)
    publisher._moving = MovingTransforms([joint("a", "prismatic"), joint("b", "prismatic")], "")
    for stamp_s in (1.0, 2.0):
        publisher.publish([states(stamp_s, a=0.1), states(stamp_s, a=math.nan, b=0.2)], STAMP)
    assert [set(shown(message.transforms)) for message in published] == [{"after_a", "after_b"}] * 2


def states(stamp_s: float, **positions: float) -> JointStates:
    values = np.array(list(positions.values()))
    return JointStates(stamp_s, tuple(positions), values, values, values)


def test_frames_have_the_prefix_of_the_robot() -> None:
    joints = {"a": joint("a", "revolute"), "f": joint("f", "fixed")}
    (moving,) = MovingTransforms(joints.values(), "left/").transforms(("a",), (0.1,), STAMP)
    (fixed,) = fixed_transforms(joints, "left/", STAMP)
    assert (moving.header.frame_id, moving.child_frame_id) == ("left/before_a", "left/after_a")
    assert (fixed.header.frame_id, fixed.child_frame_id) == ("left/before_f", "left/after_f")
