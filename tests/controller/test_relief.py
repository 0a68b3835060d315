"""Test that an arm stops after the end of a goal, and does not press against an obstacle."""

from collections.abc import Callable

import numpy as np
import pytest

from controller.action_goals import GoalStatus
from controller.manager.switch import SwitchRequest
from controller.shutdown import shut_down
from controller.trajectory.goal import GoalHandle
from controller.trajectory.goal_result import ErrorCode
from hal.lifecycle import LifecycleState
from hal.types import FloatArray, JointFault
from tests.controller.bench import ARM_LIMITS, PERIOD_S, Bench, arm_parameters, to
from tests.controller.moveit_plans import off_line

ELBOW = 1
PRESSES_RAD = 0.02
"""Minimum following error at which a joint on this bench counts as pressing against an obstacle, in rad."""


def measured(bench: Bench) -> FloatArray:
    assert bench.arm.tracking is not None
    return bench.arm.tracking.feedback_position


def ended(bench: Bench, handle: GoalHandle, least_s: float = 2.0) -> FloatArray:
    """Return the measured positions (k, 2) until the goal has ended, and for some time after it."""
    seen = []
    bench.loop.on_cycle = lambda state: seen.append(state.position[:2].copy())
    bench.cycles_until(lambda: handle.done)
    bench.cycle(round(least_s / PERIOD_S))
    return np.array(seen)


def aborts(bench: Bench) -> None:
    """Run until the result of the goal is known, but has not been sent to its client yet."""
    bench.cycles_until(lambda: (active := bench.arm._execution.active) is not None and active.ending is not None)


@pytest.mark.parametrize("per_cycle", [0.06, 0.1, 0.14])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_lagging_joint_brakes_on_its_path_and_never_moves_back(per_cycle: float, sign: float) -> None:
    bench = Bench().up()
    bench.send(to(0.9, 1.8, after_s=0.7))
    bench.cycle(40)
    whole, bench = bench.path()[:, :2], Bench().up()
    bench.hardware.slow = {"elbow": per_cycle}
    handle = bench.send(to(sign * 0.9, sign * 1.8, after_s=0.7, path={"elbow": 0.2}))
    bench.cycle()
    seen = ended(bench, handle) * sign
    assert handle.error_code == ErrorCode.PATH_TOLERANCE_VIOLATED
    commands = bench.path()[:, :2] * sign
    assert (np.diff(commands, axis=0) >= -1e-9).all(), "the command comes back"
    assert (np.diff(seen, axis=0) >= -1e-9).all(), "the arm comes back"
    assert off_line(commands, whole) < 0.01
    assert seen[-1] == pytest.approx(commands[-1])
    velocity = np.diff(commands, axis=0) / PERIOD_S
    assert np.abs(np.diff(velocity, axis=0)).max() <= ARM_LIMITS.acceleration * PERIOD_S * (1 + 1e-6)


def cancel(bench: Bench, handle: GoalHandle) -> None:
    bench.cycle(25)
    bench.arm.cancel(handle)


def nothing(bench: Bench, handle: GoalHandle) -> None:
    pass


def falls_silent(bench: Bench, handle: GoalHandle) -> None:
    bench.cycle(5)
    bench.hardware.faults = {"shoulder": JointFault("silent", "shoulder: servo 1 does not respond")}
    bench.cycles_until(lambda: handle.done)
    bench.hardware.faults = {}


ENDINGS: dict[str, tuple[dict[str, object], Callable[[Bench, GoalHandle], None], GoalStatus]] = {
    "path tolerance": ({"constraints": {"elbow": {"trajectory": 0.1}}}, nothing, GoalStatus.ABORTED),
    "goal time": ({"constraints": {"elbow": {"goal": 0.03}, "goal_time": 0.3}}, nothing, GoalStatus.ABORTED),
    "cancel": ({"constraints": {"elbow": {"goal": 0.03}}}, cancel, GoalStatus.CANCELED),
    "time-out": ({"cmd_timeout": 0.3, "constraints": {"elbow": {"goal": 0.03}}}, nothing, GoalStatus.ABORTED),
    "time-out after a success": ({"cmd_timeout": 0.3}, nothing, GoalStatus.SUCCEEDED),
    "a silent servo": ({}, falls_silent, GoalStatus.ABORTED),
}


@pytest.mark.parametrize(("said", "then", "status"), ENDINGS.values(), ids=ENDINGS)
@pytest.mark.parametrize("held_at", [0.0, 0.3, 0.5])
def test_a_blocked_joint_stops_pressing_after_every_kind_of_goal_end(
    said: dict[str, object], then: Callable[[Bench, GoalHandle], None], status: GoalStatus, held_at: float
) -> None:
    bench = Bench(arm_parameters(**said)).up()
    bench.hardware.objects = {"elbow": held_at}
    handle = bench.send(to(0.4, 0.8))
    then(bench, handle)
    seen = ended(bench, handle, 4.0)
    assert handle.status is status
    assert status is not GoalStatus.ABORTED or handle.error_text
    assert seen[-1][ELBOW] == pytest.approx(held_at) and (np.diff(seen[:, ELBOW]) >= -1e-9).all()
    assert bench.path()[-1][ELBOW] == pytest.approx(held_at, abs=PRESSES_RAD)
    after = bench.send(to(0.0, 0.0))
    bench.cycles_until(lambda: after.done)
    assert after.status is GoalStatus.SUCCEEDED


def test_the_client_gets_the_result_after_the_arm_is_relieved() -> None:
    bench = Bench().up()
    bench.hardware.objects = {"elbow": 0.3}
    handle = bench.send(to(0.4, 0.8, goal={"elbow": 0.03}, goal_time_s=0.3))
    bench.cycles_until(lambda: handle.done)
    assert abs(bench.path()[-1][ELBOW] - 0.3) < PRESSES_RAD
    at_rest = bench.path()[-1]
    bench.cycle(10)
    assert bench.path()[-1] == pytest.approx(at_rest)


@pytest.mark.parametrize("offset", [-0.4, 0.4])
def test_a_joint_with_a_constant_measurement_error_is_not_moved(offset: float) -> None:
    """The joint follows its command, but its measurement has a constant error."""
    bench = Bench().up()
    handle = bench.send(to(1.0, 1.0, path={"elbow": 0.2}))
    bench.cycle(10)
    read = bench.hardware.read

    def beside():  # type: ignore[no-untyped-def]
        state = read()
        state.position[ELBOW] += offset
        return state

    bench.hardware.read = beside  # type: ignore[method-assign]
    aborts(bench)
    bench.cycle(8)
    rested = bench.path()[-1][ELBOW]
    ended(bench, handle)
    assert handle.error_code == ErrorCode.PATH_TOLERANCE_VIOLATED
    assert abs(bench.path()[-1][ELBOW] - rested) < 0.08
    assert bench.path()[-1] == pytest.approx(bench.path()[-2])


def test_a_cancel_does_not_lower_a_sagging_joint() -> None:
    bench = Bench().up()
    read = bench.hardware.read

    def sagging():  # type: ignore[no-untyped-def]
        state = read()
        state.position[ELBOW] -= 0.05
        return state

    bench.hardware.read = sagging  # type: ignore[method-assign]
    for _ in range(5):
        before = bench.loop.command[ELBOW]
        handle = bench.send(to(0.0, float(before), after_s=2.0))
        bench.cycle(5)
        bench.arm.cancel(handle)
        ended(bench, handle)
        assert abs(bench.loop.command[ELBOW] - before) < 0.04


def test_a_joint_that_becomes_free_during_its_relief_stops() -> None:
    bench = Bench().up()
    bench.hardware.objects = {"elbow": 0.3}
    handle = bench.send(to(0.0, 0.9, goal={"elbow": 0.03}, goal_time_s=0.3))
    aborts(bench)
    highest = bench.path()[-1][ELBOW]
    bench.cycles_until(lambda: bench.path()[-1][ELBOW] < 0.8)
    bench.hardware.objects = {}
    seen = ended(bench, handle)
    assert bench.path()[-1][ELBOW] == pytest.approx(seen[-1][ELBOW])
    assert 0.5 < bench.path()[-1][ELBOW] < highest


def test_a_joint_that_becomes_free_does_not_leave_another_joint_pressing() -> None:
    bench = Bench().up()
    bench.hardware.objects = {"shoulder": 0.3, "elbow": 0.3}
    handle = bench.send(to(0.9, 0.9, goal={"elbow": 0.03}, goal_time_s=0.3))
    aborts(bench)
    bench.cycles_until(lambda: bench.path()[-1][ELBOW] < 0.8)
    bench.hardware.objects = {"shoulder": 0.3}
    seen = ended(bench, handle, 4.0)
    assert bench.path()[-1][:2] == pytest.approx(seen[-1], abs=PRESSES_RAD)


def test_a_new_goal_ends_the_relief() -> None:
    bench = Bench().up()
    bench.hardware.objects = {"elbow": 0.3}
    bench.send(to(0.0, 0.9, goal={"elbow": 0.03}, goal_time_s=0.3))
    aborts(bench)
    bench.cycle(8)
    second = bench.send(to(0.5, 0.0))
    bench.cycles_until(lambda: second.done)
    assert second.status is GoalStatus.SUCCEEDED
    assert bench.path()[-1][:2] == pytest.approx((0.5, 0.0))
    assert np.abs(np.diff(bench.path()[:, :2], axis=0)).max() <= ARM_LIMITS.velocity * PERIOD_S


# Without a controller


def deactivate(bench: Bench) -> None:
    bench.manager.switch(SwitchRequest((), ("arm",)), bench.loop.command)


def pressing(bench: Bench, at_rest: bool = True) -> Bench:
    """Return a bench whose elbow presses on an object at 0.3, during or after a motion to 0.8."""
    bench.up()
    bench.hardware.objects = {"elbow": 0.3}
    bench.send(to(0.4, 0.8))
    bench.cycle(3)
    bench.cycles_until(lambda: bench.path()[-1][ELBOW] > (0.799 if at_rest else 0.5))
    return bench


def set_inactive(bench: Bench) -> None:
    change = bench.loop.component_transitions.ask("scripted", LifecycleState.INACTIVE)
    bench.cycles_until(lambda: change.done)
    assert change.result() is None


def fail(bench: Bench) -> None:
    def update(*args: object) -> None:
        raise RuntimeError("a defect")

    bench.arm.update = update  # type: ignore[method-assign]


def hold_at_the_end(bench: Bench) -> None:
    assert shut_down(bench.loop, False, None, 1.0) == []
    assert bench.hardware.state is LifecycleState.UNCONFIGURED


@pytest.mark.parametrize("at_rest", [False, True], ids=["on the way", "at rest"])
@pytest.mark.parametrize("end", [deactivate, set_inactive, fail, hold_at_the_end])
def test_a_deactivated_controller_leaves_no_joint_pressing(end: Callable[[Bench], None], at_rest: bool) -> None:
    bench = pressing(Bench(), at_rest)
    written = len(bench.hardware.written)
    end(bench)
    if end in (deactivate, fail):
        bench.cycle(80)
    after = bench.path()[written:]
    assert after[-1][ELBOW] == pytest.approx(0.3, abs=PRESSES_RAD)
    assert np.abs(np.diff(after[-3:], axis=0)).max() < 1e-4
    path = bench.path()[written - 3 :, :2]
    assert np.abs(np.diff(path, 2, axis=0)).max() <= ARM_LIMITS.acceleration * PERIOD_S**2 * (1 + 1e-6)
    assert (np.diff(path[:, 0]) >= -1e-9).all(), "the other joint comes to rest and stays"


def test_a_joint_that_slides_along_its_obstacle_is_relieved_when_it_comes_to_rest() -> None:
    bench = pressing(Bench())
    deactivate(bench)
    for _ in range(40):
        bench.hardware.objects["elbow"] -= 0.01
        bench.cycle()
    bench.cycle(60)
    assert bench.path()[-1][ELBOW] == pytest.approx(-0.1, abs=PRESSES_RAD)


def test_a_joint_that_is_pushed_without_a_controller_is_relieved_at_the_end() -> None:
    bench = Bench().up()
    deactivate(bench)
    bench.cycle(80)
    bench.hardware.objects = {"elbow": -0.2}
    bench.cycle(20)
    assert bench.path()[-1][ELBOW] == pytest.approx(0.0), "the arm keeps its command"
    hold_at_the_end(bench)
    assert bench.path()[-1][ELBOW] == pytest.approx(-0.2, abs=PRESSES_RAD)


def test_a_free_arm_keeps_its_command_when_its_controller_is_deactivated() -> None:
    bench = Bench().up()
    handle = bench.send(to(0.4, 0.8))
    bench.cycles_until(lambda: handle.done)
    before = bench.path()[-1]
    deactivate(bench)
    bench.cycle(40)
    assert (bench.path()[-40:] == before).all()


def test_a_hand_keeps_its_grip_when_its_controller_is_deactivated() -> None:
    bench = Bench().up()
    bench.hardware.objects = {"finger": 0.02}
    bench.hand.submit([0.05])
    bench.cycle(40)
    bench.manager.switch(SwitchRequest((), ("hand",)), bench.loop.command)
    bench.cycle(80)
    assert bench.path()[-1][2] == pytest.approx(0.05)


def test_a_new_controller_takes_over_relieved_joints_within_the_limits() -> None:
    bench = pressing(Bench())
    deactivate(bench)
    bench.cycles_until(lambda: bench.path()[-1][ELBOW] < 0.7)
    bench.manager.switch(SwitchRequest(("arm",), ()), bench.loop.command)
    bench.cycle(5)
    handle = bench.send(to(0.4, 0.0))
    bench.cycles_until(lambda: handle.done)
    assert handle.status is GoalStatus.SUCCEEDED
    velocity = np.diff(bench.path()[:, :2], axis=0) / PERIOD_S
    assert np.abs(np.diff(velocity, axis=0)).max() <= ARM_LIMITS.acceleration * PERIOD_S * (1 + 1e-6)


def test_a_deactivation_during_the_relief_continues_it_within_the_limits() -> None:
    bench = pressing(Bench())
    deactivate(bench)
    bench.cycles_until(lambda: bench.path()[-1][ELBOW] < 0.6)
    written = len(bench.path())
    hold_at_the_end(bench)
    path = bench.path()[written - 3 :, ELBOW]
    assert path[-1] == pytest.approx(0.3, abs=PRESSES_RAD)
    assert np.abs(np.diff(path, 2)).max() <= ARM_LIMITS.acceleration * PERIOD_S**2 * (1 + 1e-6)


def test_unmeasured_joints_are_not_relieved_and_do_not_delay_others() -> None:
    bench = pressing(Bench())
    bench.hardware.faults = dict.fromkeys(bench.hardware.joints, JointFault("silent", "no servo responds"))
    before = bench.path()[-1]
    set_inactive(bench)
    assert bench.path()[-1] == pytest.approx(before, abs=0.01)
    assert "hold" in bench.hardware.calls
