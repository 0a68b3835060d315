"""Test a gripper controller with fingers that follow, touch an object or stop answering."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from controller.action_goals import DEACTIVATED, NOT_RUNNING, PREEMPTED, GoalStatus
from controller.gripper.goal import GripperGoal, GripperHandle, GripperParameters
from controller.gripper.gripper_action_controller import GripperActionController, PositionGripperActionController
from controller.interface import ControllerContext
from controller.motion import MotionError
from hal.fault_timeout import FAULT_CYCLES
from hal.robot_description.description import Description, HardwareInfo
from hal.types import FloatArray, JointFault, JointLimits, JointState

PERIOD_S = 0.05
LIMITS = JointLimits(0.0, 0.05, velocity=0.1, acceleration=1.0, jerk=20.0)
NAN, INF = float("nan"), float("inf")


def gripper(**parameters: Any) -> GripperActionController:
    asked = {"goal_tolerance": 0.001, **parameters, "joint": "finger"}
    return GripperActionController("gripper", GripperParameters.model_validate(asked), LIMITS, 1)


@dataclass
class Fingers:
    """A gripper and its fingers. An object blocks the fingers at ``wall``."""

    controller: GripperActionController = field(default_factory=gripper)
    wall: float = 1.0
    silent: bool = False
    says_velocity: bool = True
    position: float = 0.0
    velocity: float = 0.0
    now_s: float = 10.0
    path: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.controller.activate(self.state(), np.array([self.position]))

    def state(self) -> JointState:
        faults = {"finger": JointFault("silent", "finger: no reply")} if self.silent else {}
        velocity = np.array([9.0, self.velocity if self.says_velocity else 0.0])
        return JointState(self.now_s, np.array([9.0, self.position]), velocity, np.array([9.0, 0.7]), faults)

    def cycle(self, count: int = 1) -> None:
        for _ in range(count):
            self.now_s += PERIOD_S
            self.controller.update(self.state(), self.now_s, PERIOD_S)
            (command,) = self.controller.command
            self.path.append(float(command))
            reached = self.position if self.silent else min(float(command), self.wall)
            self.position, self.velocity = reached, (reached - self.position) / PERIOD_S

    def send(self, position: float, max_velocity: float = 0.0) -> GripperHandle:
        goal = GripperGoal(position, max_velocity)
        assert self.controller.check(goal) is None
        return self.controller.submit(goal)

    def cycles_until_done(self, handle: GripperHandle, longest: int = 400) -> int:
        for count in range(longest):
            if handle.done:
                return count
            self.cycle()
        raise AssertionError(f"not within {longest} cycles")

    def speeds(self) -> FloatArray:
        return np.diff([0.0, *self.path]) / PERIOD_S


def test_a_goal_succeeds_with_the_measured_position() -> None:
    fingers = Fingers()
    handle = fingers.send(0.05)
    fingers.cycles_until_done(handle)
    assert handle.status is GoalStatus.SUCCEEDED
    assert handle.state.reached_goal
    assert not handle.state.stalled
    assert handle.state.position == pytest.approx(0.05, abs=0.001)
    assert handle.state.effort == 0.7
    fingers.cycle(20)
    assert fingers.path[-1] == pytest.approx(0.05)


def test_the_gripper_holds_the_last_command_until_the_first_goal() -> None:
    fingers = Fingers(position=0.03)
    fingers.cycle(5)
    assert fingers.path == pytest.approx([0.03] * 5)
    assert fingers.controller.settled()


def test_the_motion_keeps_the_limits_of_the_joint() -> None:
    fingers = Fingers()
    fingers.send(0.05)
    fingers.cycle(40)
    speeds = fingers.speeds()
    assert speeds.max() == pytest.approx(LIMITS.velocity, rel=0.05)
    assert speeds.max() <= LIMITS.velocity + 1e-9
    assert np.abs(np.diff(speeds)).max() <= LIMITS.acceleration * PERIOD_S + 1e-9


@pytest.mark.parametrize(
    ("asked", "parameter", "expected"),
    [(0.02, 0.0, 0.02), (0.02, 0.05, 0.02), (0.0, 0.05, 0.05), (0.0, 0.0, 0.1), (5.0, 0.05, 0.1)],
    ids=["goal", "goal before parameter", "parameter", "joint's own", "never above the joint's own"],
)
def test_the_velocity_is_bounded_by_goal_parameter_and_joint(asked: float, parameter: float, expected: float) -> None:
    fingers = Fingers(gripper(max_velocity=parameter))
    fingers.send(0.05, asked)
    fingers.cycle(80)
    assert fingers.speeds().max() == pytest.approx(expected, rel=0.05)
    assert fingers.speeds().max() <= expected + 1e-9


@pytest.mark.parametrize(
    ("goal", "words"),
    [
        (GripperGoal(NAN), "the position of finger must be finite, not nan"),
        (GripperGoal(INF), "the position of finger must be finite, not inf"),
        (GripperGoal(0.06), "position 0.06 is outside the limits 0 to 0.05 of finger"),
        (GripperGoal(-0.01), "position -0.01 is outside the limits 0 to 0.05 of finger"),
        (GripperGoal(0.01, NAN), "max velocity of finger must be finite and at least 0, not nan"),
        (GripperGoal(0.01, -1.0), "max velocity of finger must be finite and at least 0, not -1.0"),
        (
            GripperGoal(0.01, 0.001),
            "max velocity must be above the stall_velocity_threshold 0.001, not 0.001",
        ),
        (GripperGoal(0.01, 0.0, INF), "max effort of finger must be finite and at least 0, not inf"),
        (GripperGoal(0.01, 0.0, -5.0), "max effort of finger must be finite and at least 0, not -5.0"),
        (GripperGoal(0.05, 0.1, 40.0), None),
    ],
)
def test_an_invalid_goal_is_rejected_with_its_values(goal: GripperGoal, words: str | None) -> None:
    assert Fingers().controller.check(goal) == words


# Stalls


@pytest.mark.parametrize(("allow", "status"), [(True, GoalStatus.SUCCEEDED), (False, GoalStatus.ABORTED)])
@pytest.mark.parametrize("says_velocity", [True, False])
def test_fingers_on_an_object_have_stalled_and_keep_holding_it(
    allow: bool, status: GoalStatus, says_velocity: bool
) -> None:
    fingers = Fingers(gripper(allow_stalling=allow, stall_timeout=0.3), wall=0.02, says_velocity=says_velocity)
    handle = fingers.send(0.05)
    fingers.cycles_until_done(handle)
    assert handle.status is status
    assert handle.state.stalled
    assert not handle.state.reached_goal
    assert handle.state.position == pytest.approx(0.02)
    assert handle.text == "stalled at 0.0200, short of 0.0500"
    fingers.cycle(10)
    assert fingers.path[-1] == pytest.approx(0.05)


def test_a_stall_counts_only_after_the_timeout() -> None:
    cycles = {}
    for timeout_s in (0.3, 1.0):
        fingers = Fingers(gripper(stall_timeout=timeout_s), wall=0.0)
        cycles[timeout_s] = fingers.cycles_until_done(fingers.send(0.05))
        assert timeout_s - 1e-9 <= cycles[timeout_s] * PERIOD_S <= timeout_s + 2.1 * PERIOD_S
    assert cycles[0.3] < cycles[1.0]


def test_single_counts_of_the_encoder_do_not_hide_a_stall() -> None:
    fingers = Fingers(gripper(stall_timeout=1.0, goal_tolerance=0.01), wall=0.02, says_velocity=False)
    handle = fingers.send(0.05)
    for cycle in range(400):
        fingers.cycle()
        fingers.position += 0.0015 * (cycle // 4 % 2)
        if handle.done:
            break
    assert handle.state.stalled and handle.status is GoalStatus.ABORTED


@pytest.mark.parametrize("says_velocity", [True, False])
def test_slow_fingers_are_not_stalled(says_velocity: bool) -> None:
    fingers = Fingers(gripper(stall_timeout=0.2), says_velocity=says_velocity)
    handle = fingers.send(0.05, max_velocity=0.01)
    fingers.cycles_until_done(handle)
    assert handle.status is GoalStatus.SUCCEEDED
    assert len(fingers.path) * PERIOD_S > 4.0


def test_tolerances_can_be_set_while_the_controller_runs() -> None:
    fingers = Fingers(gripper(stall_timeout=0.3), wall=0.02)
    parameters = fingers.controller.parameters
    fingers.controller.reconfigure(parameters.model_copy(update={"allow_stalling": True}))
    handle = fingers.send(0.05)
    fingers.cycles_until_done(handle)
    assert handle.status is GoalStatus.SUCCEEDED
    assert {"goal_tolerance", "stall_timeout"} <= GripperActionController.settable


# One goal at a time


def test_a_new_goal_starts_without_a_jump() -> None:
    fingers = Fingers()
    first = fingers.send(0.05)
    fingers.cycle(6)
    second = fingers.send(0.0)
    fingers.cycle()
    assert (first.status, first.text) == (GoalStatus.ABORTED, PREEMPTED)
    assert first.state.position == pytest.approx(fingers.path[-2])
    fingers.cycles_until_done(second)
    assert second.status is GoalStatus.SUCCEEDED
    assert np.abs(np.diff(fingers.speeds())).max() <= LIMITS.acceleration * PERIOD_S + 1e-9


def test_a_slower_goal_brakes_within_the_limits() -> None:
    fingers = Fingers()
    fingers.send(0.05)
    fingers.cycle(5)
    second = fingers.send(0.05, max_velocity=0.02)
    fingers.cycles_until_done(second)
    assert second.status is GoalStatus.SUCCEEDED
    assert np.abs(np.diff(fingers.speeds())).max() <= LIMITS.acceleration * PERIOD_S + 1e-9
    assert max(fingers.path) <= LIMITS.upper + 1e-9


def test_the_second_of_two_goals_in_a_cycle_is_executed() -> None:
    fingers = Fingers()
    first, second = fingers.send(0.05), fingers.send(0.02)
    fingers.cycle()
    assert (first.status, second.status) == (GoalStatus.ABORTED, GoalStatus.EXECUTING)
    fingers.cycles_until_done(second)
    assert max(fingers.path) <= 0.02 + 1e-9


def test_a_cancel_stops_without_a_step_back() -> None:
    fingers = Fingers()
    handle = fingers.send(0.05)
    fingers.cycle(6)
    fingers.controller.cancel(handle)
    fingers.cycle()
    assert handle.status is GoalStatus.CANCELED
    fingers.cycle(20)
    assert np.diff(fingers.path).min() >= -1e-9
    assert fingers.path[-1] < 0.05
    assert np.abs(np.diff(fingers.speeds())).max() <= LIMITS.acceleration * PERIOD_S + 1e-9
    assert fingers.path[-1] == fingers.path[-2]


def test_a_cancel_of_a_finished_goal_has_no_effect() -> None:
    fingers = Fingers()
    handle = fingers.send(0.02)
    fingers.cycles_until_done(handle)
    fingers.controller.cancel(handle)
    fingers.cycle(20)
    assert handle.status is GoalStatus.SUCCEEDED
    assert fingers.path[-1] == pytest.approx(0.02)


def test_a_goal_can_be_canceled_before_it_starts() -> None:
    fingers = Fingers()
    handle = fingers.send(0.02)
    fingers.controller.cancel(handle)
    fingers.cycle(3)
    assert handle.status is GoalStatus.CANCELED
    assert fingers.path == pytest.approx([0.0] * 3)


def test_a_goal_that_is_canceled_before_it_starts_still_replaces_the_active_goal() -> None:
    fingers = Fingers()
    first = fingers.send(0.05)
    fingers.cycle(6)
    second = fingers.send(0.0)
    assert fingers.controller.newest_goal is second
    fingers.controller.cancel(second)
    fingers.cycle(20)
    assert (first.status, second.status) == (GoalStatus.ABORTED, GoalStatus.CANCELED)
    assert 0.0 < fingers.path[-1] == fingers.path[-2] < 0.05


# Lifecycle and faults


def test_an_inactive_gripper_rejects_goals() -> None:
    controller = gripper()
    assert controller.check(GripperGoal(0.02)) == NOT_RUNNING
    handle = controller.submit(GripperGoal(0.02))
    assert (handle.status, handle.text) == (GoalStatus.ABORTED, DEACTIVATED)
    fingers = Fingers(controller)
    fingers.cycle(5)
    assert fingers.path == pytest.approx([0.0] * 5)


def test_deactivation_aborts_the_active_and_the_queued_goals() -> None:
    fingers = Fingers()
    first = fingers.send(0.05)
    fingers.cycle(3)
    second = fingers.send(0.02)
    fingers.controller.deactivate()
    for handle in (first, second):
        assert (handle.status, handle.text) == (GoalStatus.ABORTED, DEACTIVATED)
    assert fingers.controller.state is None
    assert fingers.controller.check(GripperGoal(0.02)) == NOT_RUNNING
    fingers.controller.activate(fingers.state(), np.array([fingers.position]))
    fingers.cycle(5)
    assert fingers.path[-1] == pytest.approx(fingers.path[2])
    assert fingers.controller.settled()


def test_a_lasting_silence_aborts_the_goal_and_a_short_one_does_not() -> None:
    fingers = Fingers()
    handle = fingers.send(0.05)
    fingers.silent = True
    fingers.cycle(2)
    fingers.silent = False
    fingers.cycle(1)
    assert not handle.done
    fingers.silent = True
    fingers.cycle(FAULT_CYCLES - 1)
    assert not handle.done
    fingers.cycle(1)
    assert (handle.status, handle.text) == (GoalStatus.ABORTED, "finger: no reply")
    fingers.silent = False
    fingers.cycle(20)
    assert fingers.path[-1] == fingers.path[-2] < 0.05


def test_unmeasured_fingers_do_not_stall() -> None:
    fingers = Fingers(gripper(allow_stalling=True, stall_timeout=0.1))
    handle = fingers.send(0.05)
    for _ in range(2):
        fingers.cycle(2)
        fingers.silent = True
        fingers.cycle(4)
        fingers.silent = False
    assert not handle.done
    fingers.cycles_until_done(handle)
    assert handle.status is GoalStatus.SUCCEEDED and handle.state.reached_goal


def test_a_goal_without_a_possible_motion_is_aborted_with_the_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_way(*arguments: object) -> None:
        raise MotionError("no motion within the limits")

    fingers = Fingers()
    monkeypatch.setattr("controller.gripper.gripper_action_controller.motion_to", no_way)
    handle = fingers.send(0.05)
    fingers.cycle(10)
    assert (handle.status, handle.text) == (GoalStatus.ABORTED, "no motion within the limits")
    assert fingers.path == pytest.approx([0.0] * 10)
    assert fingers.controller.settled()


def test_a_goal_continues_without_a_leap_after_the_loop_has_stalled() -> None:
    fingers = Fingers()
    fingers.send(0.05)
    fingers.cycle(4)
    fingers.now_s += 10.0
    fingers.cycle(1)
    assert fingers.path[-1] - fingers.path[-2] <= 2.0 * LIMITS.velocity * PERIOD_S + 1e-9


# Settling


def test_the_gripper_is_unsettled_from_the_goal_to_its_arrival() -> None:
    fingers = Fingers()
    handle = fingers.send(0.05)
    assert not fingers.controller.settled()
    fingers.cycles_until_done(handle)
    fingers.cycle(10)
    assert fingers.controller.settled()


def test_the_gripper_is_settled_when_its_fingers_hold_an_object() -> None:
    fingers = Fingers(gripper(stall_timeout=0.3), wall=0.02)
    fingers.cycles_until_done(fingers.send(0.05))
    fingers.cycle(10)
    assert fingers.controller.settled()


def test_a_slow_motion_within_the_tolerance_is_not_settled() -> None:
    fingers = Fingers(gripper(goal_tolerance=0.05))
    handle = fingers.send(0.04, max_velocity=0.0015)
    fingers.cycle(20)
    assert handle.status is GoalStatus.SUCCEEDED
    assert not fingers.controller.settled()


# Parameters


def test_the_defaults_are_those_of_ros2_control_except_for_the_velocity() -> None:
    assert GripperParameters(joint="finger").model_dump() == {
        "joint": "finger",
        "action_monitor_rate": 20.0,
        "goal_tolerance": 0.01,
        "allow_stalling": False,
        "stall_velocity_threshold": 0.001,
        "stall_timeout": 1.0,
        "max_velocity": 0.0,
        "max_effort": 0.0,
        "state_interfaces": ("position", "velocity"),
        "max_effort_interface": "",
        "max_velocity_interface": "",
    }


@pytest.mark.parametrize(
    ("parameters", "unused"),
    [
        ({}, []),
        ({"max_effort": 10.0}, ["max_effort (torque_limit in the robot file limits the force)"]),
        (
            {"max_velocity_interface": "f/v"},
            ["max_velocity_interface (the planned motion already limits the velocity)"],
        ),
        ({"gains": {}}, ["gains"]),
    ],
)
def test_parameters_without_effect_are_listed(parameters: dict[str, Any], unused: list[str]) -> None:
    assert gripper(**parameters).parameters.unused() == unused


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"max_effort_interface": "finger/max_effort"}, "finger/max_effort cannot be set by this controller: remove"),
        ({"goal_tolerance": -1.0}, "goal_tolerance"),
        ({"stall_timeout": NAN}, "stall_timeout"),
        ({"action_monitor_rate": 0.01}, "action_monitor_rate"),
    ],
)
def test_unsupported_parameters_are_rejected(parameters: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        gripper(**parameters)


@pytest.mark.parametrize("kind", [GripperActionController, PositionGripperActionController])
def test_the_controller_is_built_from_the_controllers_file(kind: type[GripperActionController]) -> None:
    interfaces = dict.fromkeys(("joint1", "finger"), ("position",))
    component = HardwareInfo("arm", "system", "mock", {}, interfaces, interfaces)
    limits = {"joint1": replace(LIMITS, upper=9.0), "finger": LIMITS}
    context = ControllerContext(Description("", {}), component, limits, lambda name: True)
    made = kind.build("gripper", GripperParameters(joint="finger"), context)
    assert made.kind.endswith("/GripperActionController")
    assert made.command_interfaces == ("finger/position",)
    fingers = Fingers(made)
    handle = fingers.send(0.05)
    fingers.cycles_until_done(handle)
    assert handle.status is GoalStatus.SUCCEEDED
