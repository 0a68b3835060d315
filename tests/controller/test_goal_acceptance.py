"""Test which goals are rejected. If ros2_control makes the same check, the message must equal that of ros2_control."""

import dataclasses

import numpy as np
import pytest

from controller.action_goals import GoalStatus
from controller.trajectory.goal import (
    LARGEST_GOAL,
    Allowed,
    GoalHandle,
    GoalPoint,
    TrajectoryGoal,
    limits_reason,
    reason_to_reject,
)
from controller.trajectory.goal_result import ErrorCode
from controller.trajectory.tolerances import Tolerances, resolve
from hal.types import JointLimits

JOINTS = ("joint1", "joint2")
LIMITS = (JointLimits(-2.0, 2.0, 4.0, 12.0, 120.0), JointLimits(-1.0, 1.0, 3.0, 12.0, 120.0))
NAN, INF = float("nan"), float("inf")


def point(
    positions: tuple[float, ...] = (0.5, 0.5),
    after_s: float = 1.0,
    velocities: tuple[float, ...] = (),
    accelerations: tuple[float, ...] = (),
) -> GoalPoint:
    return GoalPoint(positions, after_s, velocities, accelerations)


def goal(*points: GoalPoint, joints: tuple[str, ...] = JOINTS, delay_s: float = 0.0) -> TrajectoryGoal:
    return TrajectoryGoal(joints, points, delay_s=delay_s)


MISMATCH = "Joints on incoming trajectory don't match the controller joints."
NAME_THEM = "but the controller has 2 (joint1, joint2): name each joint of the controller."

FAR = (
    "the trajectory would end {} s from now, but the maximum is 3600 s: check that its point times start at 0 "
    "and that its stamp uses the stack's clock (or /clock in simulated time)"
)
ORDINARY = Allowed()


def reason(asked: TrajectoryGoal, allowed: Allowed = ORDINARY) -> str | None:
    """Return the reason why a goal is rejected, either because of its own content or because of the limits."""
    return reason_to_reject(asked, JOINTS, allowed) or limits_reason(asked, JOINTS, LIMITS)


REFUSED = {
    "no joints": (goal(point(()), joints=()), f"{MISMATCH} The goal names no joints, {NAME_THEM}"),
    "a joint missing": (goal(point((0.5,)), joints=("joint1",)), f"{MISMATCH} The goal names 1 (joint1), {NAME_THEM}"),
    "a joint too many": (
        goal(point((0.5,) * 3), joints=(*JOINTS, "joint3")),
        f"{MISMATCH} The goal names 3 (joint1, joint2, joint3), {NAME_THEM}",
    ),
    "thousands of joints": (
        goal(point((0.5,) * 3), joints=("j",) * 5000),
        f"{MISMATCH} The goal names 5000 ({'j, ' * 20}…), {NAME_THEM}",
    ),
    "an unknown joint": (
        goal(point(), joints=("joint1", "foo")),
        "Incoming joint foo doesn't match the controller's joints. The controller has 2 (joint1, joint2): "
        "correct the name.",
    ),
    "a joint twice": (goal(point(), joints=("joint1", "joint1")), "Joint joint1 is named twice: name each joint once."),
    "no points": (goal(), "Empty trajectory received."),
    "positions too short": (
        goal(point((0.5,))),
        "Mismatch between joint_names size (2) and positions (1) at point #0.",
    ),
    "positions too long": (
        goal(point(), point((0.5,) * 3, 2.0)),
        "Mismatch between joint_names size (2) and positions (3) at point #1.",
    ),
    "velocities only": (
        goal(point((), velocities=(0.1, 0.1))),
        "Mismatch between joint_names size (2) and positions (0) at point #0.",
    ),
    "velocities of another length": (
        goal(point(velocities=(0.1,))),
        "Mismatch between joint_names size (2) and velocities (1) at point #0.",
    ),
    "accelerations of another length": (
        goal(point(accelerations=(0.1,) * 3)),
        "Mismatch between joint_names size (2) and accelerations (3) at point #0.",
    ),
    "equal times": (
        goal(point(), point()),
        "Time between points 0 and 1 is not strictly increasing, it is 1.000000 and 1.000000 respectively",
    ),
    "decreasing times": (
        goal(point(), point(after_s=0.5)),
        "Time between points 0 and 1 is not strictly increasing, it is 1.000000 and 0.500000 respectively",
    ),
    "a NaN time": (goal(point(after_s=NAN)), "times must be finite, not nan s"),
    "an infinite time": (
        goal(point(), point(after_s=INF)),
        "times must be finite, not 1.0, inf s",
    ),
    "an end in the past": (
        goal(point(after_s=1.0), delay_s=-1.5),
        "Received trajectory with non-zero start time that ends in the past (0.500 s ago)",
    ),
    "times since 1970": (goal(point(after_s=1.76e9)), FAR.format(1760000000)),
    "a stamp of another clock": (goal(point(after_s=1.0), delay_s=1.76e9), FAR.format(1760000001)),
    "NaN": (goal(point((NAN, 0.0))), "joint1 must be finite at point #0, not nan"),
    "inf": (goal(point((0.0, INF))), "joint2 must be finite at point #0, not inf"),
    "NaN in the middle": (
        goal(point(), point((0.0, NAN), 2.0), point(after_s=3.0)),
        "joint2 must be finite at point #1, not nan",
    ),
    "NaN velocity": (
        goal(point(velocities=(NAN, 0.0))),
        "joint1 must be finite at point #0, not nan",
    ),
    "inf acceleration": (
        goal(point(accelerations=(0.0, -INF))),
        "joint2 must be finite at point #0, not -inf",
    ),
    "beyond a position limit": (
        goal(point((0.0, 1.5))),
        "joint2 would go to 1.5000 at point #0, outside its limits -1.0000 to 1.0000",
    ),
    "below a position limit, in the client's order": (
        goal(point((-1.5, 0.0)), joints=("joint2", "joint1")),
        "joint2 would go to -1.5000 at point #0, outside its limits -1.0000 to 1.0000",
    ),
    "beyond a velocity limit": (
        goal(point(velocities=(0.0, -3.5)), point(after_s=2.0)),
        "joint2 would move at -3.5000 at point #0, beyond its limit 3.0000",
    ),
    "beyond an acceleration limit": (
        goal(point(accelerations=(13.0, 0.0)), point(after_s=2.0)),
        "joint1 would accelerate at 13.0000 at point #0, beyond its limit 12.0000",
    ),
    "a final velocity that is not allowed": (
        goal(point(velocities=(0.2, 0.0))),
        "Velocity of last trajectory point of joint joint1 is not zero: 0.200000000000000",
    ),
}

ACCEPTED = {
    "one point": goal(point()),
    "two points": goal(point(), point(after_s=2.0)),
    "velocities": goal(point(velocities=(0.3, -0.3)), point(after_s=2.0, velocities=(0.0, 0.0))),
    "velocities and accelerations": goal(
        point(velocities=(0.3, 0.0), accelerations=(1.0, 0.0)), point(after_s=2.0, velocities=(0.0, 0.0))
    ),
    "accelerations without velocities": goal(point(accelerations=(1.0, 0.0))),
    "the first point at zero": goal(point(after_s=0.0), point(after_s=1.0)),
    "zero time": goal(point(after_s=0.0)),
    "negative time": goal(point(after_s=-1.0)),
    "the first of two negative": goal(point(after_s=-1.0), point(after_s=1.0)),
    "shuffled": goal(point((0.5, 2.0)), joints=("joint2", "joint1")),
    "exactly on the limits": goal(point((-2.0, 1.0), velocities=(0.0, 0.0))),
    "a stamp in the past, the end in the future": goal(point(after_s=2.0), delay_s=-1.0),
    "a stamp in the future": goal(point(after_s=1.0), delay_s=1.0),
    "an hour": goal(point(after_s=1800.0), delay_s=1800.0),
    "a last velocity below upstream's threshold": goal(point(velocities=(1e-7, 0.0))),
}


@pytest.mark.parametrize(("asked", "text"), REFUSED.values(), ids=REFUSED.keys())
def test_an_invalid_goal_is_rejected_with_its_text(asked: TrajectoryGoal, text: str) -> None:
    assert reason(asked) == text


@pytest.mark.parametrize("asked", ACCEPTED.values(), ids=ACCEPTED.keys())
def test_a_valid_goal_is_accepted(asked: TrajectoryGoal) -> None:
    assert reason(asked) is None


def test_a_final_velocity_is_accepted_if_the_controllers_file_allows_it() -> None:
    moving = goal(point(velocities=(0.2, 0.0)))
    assert reason(moving, Allowed(moving_end=True)) is None


PARTIAL = Allowed(partial=True)


def test_a_partial_goal_is_accepted_if_the_controllers_file_allows_it() -> None:
    part = goal(point((0.5,)), joints=("joint2",))
    assert reason(part, PARTIAL) is None
    assert reason(goal(point(()), joints=()), PARTIAL) == "Empty joint names on incoming trajectory."
    assert reason(goal(point((1.5,)), joints=("joint2",)), PARTIAL) is not None


@pytest.mark.parametrize(
    ("asked", "accepted"),
    [
        (point((), velocities=(0.0, 0.0)), True),
        (point((), accelerations=(0.0, 0.0)), True),
        (point(()), False),
        (point((0.1,), velocities=(0.0, 0.0)), False),
    ],
)
def test_positions_may_be_missing_if_they_can_be_integrated(asked: GoalPoint, accepted: bool) -> None:
    assert (reason(goal(asked), Allowed(integration=True)) is None) == accepted


def test_a_goal_with_too_many_points_is_rejected() -> None:
    many = goal(*(point(after_s=float(i)) for i in range(LARGEST_GOAL + 1)))
    assert reason(many) == "the goal has 5001 points: send at most 5000 points in one goal"


DEFAULTS = Tolerances({"joint1": 0.1}, {"joint1": 0.2, "joint2": 0.3}, 0.5)


@pytest.mark.parametrize(
    ("asked", "path", "at_goal", "time_s"),
    [
        (Tolerances(), (0.1, 0.0), (0.2, 0.3), 0.5),
        (Tolerances({"joint1": 0.0}, {"joint2": 0.0}), (0.1, 0.0), (0.2, 0.3), 0.5),
        (Tolerances({"joint2": 0.7}, {"joint1": 0.9}, 2.0), (0.1, 0.7), (0.9, 0.3), 2.0),
        (Tolerances({"joint1": -1.0}, {"joint2": -1.0}, -1.0), (0.0, 0.0), (0.2, 0.0), 0.0),
    ],
    ids=["none", "zero is the default", "positive overrides", "-1 erases"],
)
def test_tolerances_of_a_goal_are_combined_with_the_defaults(
    asked: Tolerances, path: tuple[float, ...], at_goal: tuple[float, ...], time_s: float
) -> None:
    resolved = resolve(asked, DEFAULTS, JOINTS)
    assert tuple(resolved.path.values()) == path
    assert tuple(resolved.goal.values()) == at_goal
    assert resolved.goal_time_s == time_s


@pytest.mark.parametrize(
    ("asked", "text"),
    [
        (Tolerances({"joint1": -2.0}), "a tolerance must be positive, 0 for the default or -1 for none, not -2.0"),
        (Tolerances({}, {"joint1": -0.5}), "a tolerance must be positive, 0 for the default or -1 for none, not -0.5"),
        (Tolerances({}, {}, -2.0), "a tolerance must be positive, 0 for the default or -1 for none, not -2.0"),
        (Tolerances({"joint1": NAN}), "not nan"),
        (Tolerances({"foo": 0.1}), "joint 'foo' specified in goal.path_tolerance does not exist"),
        (Tolerances({}, {"foo": 0.1}), "joint 'foo' specified in goal.goal_tolerance does not exist"),
    ],
)
def test_invalid_tolerances_are_rejected(asked: Tolerances, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        resolve(asked, DEFAULTS, JOINTS)


def test_the_first_result_of_a_goal_is_final() -> None:
    handle = GoalHandle(goal(point()))
    assert not handle.done
    handle.decide(GoalStatus.CANCELED, ErrorCode.SUCCESSFUL, "")
    handle.decide(GoalStatus.ABORTED, ErrorCode.INVALID_GOAL, "too late")
    assert (handle.status, handle.error_code, handle.error_text) == (GoalStatus.CANCELED, 0, "")
    assert handle.done


def test_a_goal_cannot_be_changed_after_its_check() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        goal(point()).delay_s = 1.0  # type: ignore[misc]


ROUNDED = {
    "acceleration": point(velocities=(0.0, 0.0), accelerations=(12.00000000028, -12.000000001)),
    "velocity": point(velocities=(4.00000000000014, -3.000000000001)),
    "position": point((2.0 + 1e-9, -1.0 - 1e-9)),
}


@pytest.mark.parametrize("rounded", ROUNDED.values(), ids=ROUNDED)
def test_the_rounding_of_a_planner_does_not_exceed_a_limit(rounded: GoalPoint) -> None:
    assert reason(goal(rounded, point(after_s=2.0))) is None


@pytest.mark.parametrize(
    ("value", "shown"), [(12.0000135, "12.00001"), (12.00004, "12.00004"), (12.0002, "12.0002"), (-12.5, "-12.5000")]
)
def test_the_reason_shows_the_difference(value: float, shown: str) -> None:
    text = reason(goal(point(velocities=(0.0, 0.0), accelerations=(value, 0.0)), point(after_s=2.0)))
    assert text == f"joint1 would accelerate at {shown} at point #0, beyond its limit 12.0000"


def from_where(stands: float, position: float) -> str | None:
    """Return the reason for rejecting a point at ``position`` if joint1, whose lower limit is -2, is at ``stands``."""
    return limits_reason(goal(point((position, 0.0))), JOINTS, LIMITS, [np.array((stands, 0.0))])


def test_a_joint_at_or_beyond_a_limit_may_start_from_there() -> None:
    assert from_where(-2.0008, -2.0008) is from_where(-2.0008, -2.0) is from_where(-2.0008, -2.003) is None
    assert from_where(-2.0, -2.0008) is None  # commanded to the limit, measured beyond
    assert from_where(-2.05, -2.05) is from_where(-2.05, -2.01) is None
    assert "outside its limits" in str(from_where(-2.0008, -2.006))
    assert "outside its limits" in str(from_where(-2.05, -2.06))
    assert "outside its limits" in str(from_where(-1.9, -2.0008))
    assert "outside its limits" in str(from_where(-2.05, 2.001))
