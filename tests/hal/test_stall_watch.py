"""Tests of servos that press without motion: reduction of the drive, messages, and end of a stall."""

import math
from dataclasses import dataclass, field, replace

import pytest

from drivers.servos import sts
from hal.joint import Joint
from hal.servos.servo_goals import ServoGoals
from hal.servos.stall_watch import HOLDING, SETTLE_S, STALL_S, WARN_S, StallWatch
from hal.types import JointLimits

PERIOD_S = 0.05
JAW = Joint("jaw", 6, sts.STS3215, JointLimits(-1.5, 1.5, 4.0, 12.0, 120.0), zero_counts=2048, torque_limit=0.5)
ARM = replace(JAW, torque_limit=1.0)
FULL_AHEAD = 120.0
OPEN, SHUT = 2048, 2700


@dataclass
class Jaw:
    """Jaw that is blocked at ``blocked`` counts. The drive of the jaw is proportional to the distance to its goal."""

    joint: Joint = JAW
    at: int = OPEN
    blocked: int = SHUT
    stiffness: float = 1.0 / FULL_AHEAD
    loads: list[float] = field(default_factory=list)
    goals: list[int | None] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.watch = StallWatch({"jaw": FULL_AHEAD})
        self._goal = self.at

    def run(self, command: int, seconds: float, measured: bool = True) -> None:
        for _ in range(round(seconds / PERIOD_S)):
            limit = self.joint.torque_limit
            load = max(-limit, min(limit, (self._goal - self.at) * self.stiffness))
            goal = self.watch.goal(self.joint, command, self.at if measured else None, load, PERIOD_S)
            self._goal = command if goal is None else goal
            self.loads.append(load)
            self.goals.append(goal)
            self.at = (
                min(self.at + 100, self._goal, self.blocked) if self._goal > self.at else max(self.at - 100, self._goal)
            )


def test_the_drive_of_a_pressing_jaw_is_reduced_after_the_time() -> None:
    jaw = Jaw(blocked=2400)
    jaw.run(SHUT, 4 * PERIOD_S + STALL_S)
    assert not jaw.watch.stalls and jaw.goals[-1] is None
    jaw.run(SHUT, 2 * PERIOD_S)
    assert jaw.watch.stalls["jaw"].warns
    assert jaw.loads[-1] == pytest.approx(HOLDING * 0.5, abs=0.01)
    jaw.run(SHUT, 600.0)
    assert jaw.loads[-1] == pytest.approx(HOLDING * 0.5, abs=0.02)
    assert jaw.at == 2400


def test_a_jaw_that_creeps_after_its_motion_has_pressed_since_the_end_of_the_motion() -> None:
    """In an earlier version, the stall timer restarted while the jaw crept, because the motion of the jaw had ended
    shortly before."""
    watch = StallWatch({"jaw": FULL_AHEAD})
    still = round(0.005 * sts.STS3215.counts_per_turn)
    arrives = [OPEN + still * 10, OPEN + still + 1]
    creeps = [OPEN + 4] * 11 + [OPEN] * 12
    goals = [watch.goal(JAW, OPEN - 400, here, -0.5, PERIOD_S) for here in arrives + creeps]
    assert [goal is not None for goal in goals].index(True) == len(arrives) + round(STALL_S / PERIOD_S)


def test_the_positions_of_a_long_press_are_not_kept() -> None:
    arm = Jaw(joint=ARM, blocked=2400)
    arm.run(SHUT, 60.0)
    assert arm.watch.stalls and len(arm.watch._presses["jaw"].pressed) == round(STALL_S / PERIOD_S) + 1


def test_a_gripped_object_causes_no_lasting_warning_but_a_jammed_joint_does() -> None:
    grip, jam = Jaw(blocked=2400), Jaw(blocked=OPEN)
    for jaw in (grip, jam):
        jaw.run(SHUT, STALL_S + 1.0)
        assert jaw.watch.stalls["jaw"].warns
        jaw.run(SHUT, WARN_S)
    assert not grip.watch.stalls["jaw"].warns and "gripped something" in grip.watch.stalls["jaw"].text
    assert jam.watch.stalls["jaw"].warns and "jammed or blocked" in jam.watch.stalls["jaw"].text


def test_the_log_message(caplog: pytest.LogCaptureFixture) -> None:
    jaw = Jaw(blocked=OPEN)
    jaw.run(SHUT, STALL_S + 1.0)
    jaw.watch.log.flush()
    (record,) = caplog.records
    assert record.levelname == "WARNING"
    assert record.message == (
        "jaw: servo 6 has pressed with its torque limit of 50% for 1 s without motion and holds with 18% until its "
        "next motion: the joint has not moved at all, so it is jammed or blocked. Move it back and check it"
    )


def test_the_next_motion_has_the_full_torque_limit() -> None:
    jaw = Jaw(blocked=2400)
    jaw.run(SHUT, STALL_S + 1.0)
    jaw.run(OPEN, PERIOD_S)
    assert not jaw.watch.stalls and jaw.goals[-1] is None
    jaw.run(SHUT, STALL_S)  # presses again until the drive is reduced
    assert max(jaw.loads[-5:]) == 0.5


def test_a_joint_that_comes_free_has_the_full_torque_limit() -> None:
    jaw = Jaw(blocked=2400)
    jaw.run(SHUT, STALL_S + 1.0)
    jaw.blocked = SHUT
    jaw.run(SHUT, 5.0)
    assert not jaw.watch.stalls and jaw.at == SHUT


def test_the_goal_follows_fingers_that_yield() -> None:
    """The drive stays reduced, and no new stall begins."""
    jaw = Jaw(blocked=2400)
    jaw.run(SHUT, STALL_S + 1.0)
    for _ in range(20):
        jaw.blocked = jaw.at = jaw.at - 10
        jaw.run(SHUT, 0.1)
    assert jaw.watch.stalls and max(jaw.loads[-20:]) < 0.25


@pytest.mark.parametrize("stiffness", [3.0 / FULL_AHEAD, 0.8 / FULL_AHEAD])
def test_the_drive_of_a_stiffer_or_softer_servo_is_corrected(stiffness: float) -> None:
    jaw = Jaw(blocked=2400, stiffness=stiffness)
    jaw.run(SHUT, STALL_S + SETTLE_S + 4.0)
    assert 0.7 * HOLDING * 0.5 < jaw.loads[-1] < 1.2 * HOLDING * 0.5


@pytest.mark.parametrize(
    ("joint", "blocked", "command"),
    [
        (JAW, SHUT, SHUT),  # reaches its goal
        (JAW, 2048, 2048 + 40),  # pulls with less than its torque limit
        (ARM, 2048, 2048 + 90),  # carries a load with three quarters of its torque
    ],
)
def test_joints_whose_drive_is_not_reduced(joint: Joint, blocked: int, command: int) -> None:
    jaw = Jaw(joint, blocked=blocked)
    jaw.run(command, 30.0)
    assert set(jaw.goals) == {None} and not jaw.watch.stalls


def test_a_joint_that_moves_slowly_at_full_drive_is_not_reduced() -> None:
    watch = StallWatch({"jaw": FULL_AHEAD})
    for cycle in range(400):
        assert watch.goal(JAW, SHUT, OPEN + 2 * cycle, 0.5, PERIOD_S) is None


def test_an_unknown_drive_is_not_pressing_and_a_missing_measurement_keeps_the_goal() -> None:
    watch = StallWatch({"jaw": FULL_AHEAD})
    for _ in range(200):
        assert watch.goal(JAW, SHUT, OPEN, math.nan, PERIOD_S) is None
    jaw = Jaw(blocked=2400)
    jaw.run(SHUT, STALL_S + 1.0)
    held = jaw.goals[-1]
    jaw.run(SHUT, 1.0, measured=False)
    assert jaw.goals[-1] == held is not None


def test_an_activation_resets_the_state() -> None:
    jaw = Jaw(blocked=2400)
    jaw.run(SHUT, STALL_S + 1.0)
    jaw.watch.restart([JAW.name])
    assert not jaw.watch.stalls and jaw.watch.goal(JAW, SHUT, 2400, 0.5, PERIOD_S) is None


def test_the_goal_of_a_pressing_joint_stays_within_its_limits() -> None:
    jaw = replace(JAW, limits=JointLimits(-1.5, 0.0, 4.0, 12.0, 120.0))
    goals = ServoGoals([jaw])
    goals.hold({"jaw": 2048})
    counts = [
        goals.towards([-1.0], PERIOD_S, {"jaw": 2300}, {"jaw": 0.5}, ())["jaw"].position_counts for _ in range(200)
    ]
    assert goals.stalls, "it presses beyond its upper limit of 2048 counts"
    assert max(counts) <= 2048


# Joints with full torque


def test_a_joint_with_full_torque_is_reported_and_keeps_its_torque(caplog: pytest.LogCaptureFixture) -> None:
    arm = Jaw(ARM, blocked=2400)
    arm.run(SHUT, 4 * PERIOD_S + STALL_S)
    assert not arm.watch.stalls
    arm.run(SHUT, 30.0)
    assert set(arm.goals) == {None} and arm.loads[-1] == 1.0
    assert arm.watch.stalls["jaw"].warns
    arm.watch.log.flush()
    (record,) = caplog.records
    assert record.levelname == "WARNING"
    assert record.message == "jaw: " + arm.watch.stalls["jaw"].text
    assert arm.watch.stalls["jaw"].text == (
        "servo 6 has pressed with at least 80% of its torque for 1 s without motion: the joint is blocked or "
        "overloaded. Its torque is not reduced, because a loaded joint would fall: move it back or remove the load "
        "before the servo's own protection disables its torque"
    )


@pytest.mark.parametrize("end", ["another command", "a motion", "less load"])
def test_a_joint_is_reported_only_while_it_presses(end: str) -> None:
    arm = Jaw(ARM, blocked=2400)
    arm.run(SHUT, 2.0)
    assert arm.watch.stalls
    if end == "another command":
        arm.run(OPEN, PERIOD_S)
    elif end == "a motion":
        arm.blocked = SHUT
        arm.run(SHUT, 3 * PERIOD_S)
    else:
        arm.stiffness /= 20.0
        arm.run(SHUT, 2 * PERIOD_S)
    assert not arm.watch.stalls


@pytest.mark.parametrize("joint", [ARM, JAW])
def test_a_joint_without_goals_does_not_press(joint: Joint) -> None:
    goals = ServoGoals([joint])
    goals.hold({"jaw": 2048})
    for _ in range(round(2.0 / PERIOD_S)):
        goals.towards([1.0], PERIOD_S, {"jaw": 2048}, {"jaw": joint.torque_limit}, ())
    assert goals.stalls
    goals.towards([1.0], PERIOD_S, {"jaw": 2048}, {"jaw": 0.0}, {"jaw"})
    assert not goals.stalls
