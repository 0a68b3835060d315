"""The poses of a robot's links in their parents, for the transforms of a recording."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final, NamedTuple

from hal.robot_description.description import UrdfJoint, Vector
from hal.robot_description.kinematics import Quaternion, child_pose
from hal.types import FloatArray

MOVING = ("revolute", "continuous", "prismatic")


class LinkPose(NamedTuple):
    """The pose of a link in its parent: metres and a unit quaternion (x, y, z, w)."""

    parent: str
    child: str
    position_m: Vector
    quaternion: Quaternion


Scene = Callable[[], Mapping[str, tuple[Vector, Quaternion]]]
"""Says where things stand around the arm, by name, in the world; nothing where no simulation knows."""
WORLD: Final = "base_link"
"""The frame of the things in a scene, as in ROS 2's /tf."""


def scene_poses(scene: Scene) -> tuple[LinkPose, ...]:
    """The poses of the things around the arm now."""
    return tuple(LinkPose(WORLD, name, *pose) for name, pose in scene().items())


class LinkPoses:
    """The links of a robot description; mimic joints follow theirs."""

    def __init__(self, joints: Mapping[str, UrdfJoint], measured: Sequence[str]) -> None:
        """``measured``: the hardware's joints, in the order of its states."""
        self.fixed = [_pose(joint, 0.0) for joint in joints.values() if joint.kind == "fixed"]
        self._moving = list(_moving(joints, measured))

    def moving(self, position: FloatArray) -> Iterator[LinkPose]:
        """The links that move, at the positions (n,) of the joints in rad or m; NaN leaves a link out."""
        values = position.tolist()
        for joint, index, multiplier, offset in self._moving:
            at = values[index] * multiplier + offset
            if at == at:  # not NaN
                yield _pose(joint, at)


def _moving(joints: Mapping[str, UrdfJoint], measured: Sequence[str]) -> Iterator[tuple[UrdfJoint, int, float, float]]:
    places = {name: index for index, name in enumerate(measured)}
    for joint in joints.values():
        if joint.kind not in MOVING:
            continue
        if joint.name in places:
            yield joint, places[joint.name], 1.0, 0.0
        elif joint.mimic is not None and joint.mimic.joint in places:
            yield joint, places[joint.mimic.joint], joint.mimic.multiplier, joint.mimic.offset


def _pose(joint: UrdfJoint, position: float) -> LinkPose:
    return LinkPose(joint.parent, joint.child, *child_pose(joint, position))
