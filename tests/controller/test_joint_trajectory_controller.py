"""Test the execution of trajectory goals, cycle by cycle."""

import logging
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from controller.action_goals import GoalStatus
from controller.trajectory.goal import GoalHandle, GoalPoint, TrajectoryGoal
from controller.trajectory.goal_planner import PathPlan
from controller.trajectory.goal_result import ErrorCode
from hal.fault_timeout import FAULT_CYCLES
from hal.types import FloatArray, JointFault, JointState
from tests.controller.bench import ARM, ARM_LIMITS, HAND_LIMITS, PERIOD_S, Bench, arm_parameters, through, to

REACHED = "Goal successfully reached!"
PREEMPTED = "Current goal preempted by new incoming action."
DEACTIVATED = "Current goal cancelled during deactivate transition."


def outcome(handle: GoalHandle) -> tuple[GoalStatus, int, str]:
    return handle.status, handle.error_code, handle.error_text


def assert_smooth(path: FloatArray) -> None:
    """Check that a velocity stays within its limit and changes within the acceleration limit."""
    velocity = np.diff(path[:, :2], axis=0) / PERIOD_S
    assert np.abs(velocity).max() <= ARM_LIMITS.velocity * (1 + 1e-6)
    assert np.abs(np.diff(velocity, axis=0)).max() <= ARM_LIMITS.acceleration * PERIOD_S * (1 + 1e-6)


# One goal


def test_a_goal_arrives_on_time_and_succeeds() -> None:
    bench = Bench().up()
    handle = bench.send(to(1.0, -0.5, after_s=2.0))
    cycles = bench.cycles_until(lambda: handle.done)
    assert 2.0 <= (cycles - 1) * PERIOD_S + 1e-9 <= 2.0 + PERIOD_S
    assert outcome(handle) == (GoalStatus.SUCCEEDED, ErrorCode.SUCCESSFUL, REACHED)
    assert bench.path()[-1] == pytest.approx([1.0, -0.5, 0.0])
    assert_smooth(bench.path())


def test_a_goal_moves_the_joints_in_the_next_cycle() -> None:
    bench = Bench().up()
    bench.cycle()
    bench.send(to(1.0, 0.0))
    bench.cycle()
    assert bench.path()[-1][0] > 0.0


def test_a_goal_that_is_too_fast_takes_longer_and_reports_it(caplog: pytest.LogCaptureFixture) -> None:
    bench = Bench().up()
    handle = bench.send(to(1.9, 0.0, after_s=0.1))
    bench.cycles_until(lambda: handle.done)
    assert handle.status is GoalStatus.SUCCEEDED
    assert handle.error_text.startswith(f"{REACHED} The limits stretched the motion from 0.10 s to ")
    assert "stretch the motion from 0.10 s to" in caplog.text
    assert_smooth(bench.path())


def test_a_stream_of_trajectories_that_are_too_fast_is_reported_once_a_minute(caplog: pytest.LogCaptureFixture) -> None:
    bench = Bench().up()
    for number in range(130):
        bench.send(replace(to(1.9 if number % 2 else 0.0, 0.0, after_s=0.1), from_topic=True))
        bench.cycle(10)
    begin, minute = (text for text in caplog.messages if "stretch the motion" in text)
    assert "more since" not in begin
    assert minute.endswith("(120 more since the last warning about the topic)")


@pytest.mark.parametrize("after_s", [0.0, -1.0, 0.01])
def test_a_goal_without_a_duration_moves_as_fast_as_the_limits_allow(after_s: float) -> None:
    bench = Bench().up()
    handle = bench.send(to(0.5, 0.0, after_s=after_s))
    bench.cycles_until(lambda: handle.done)
    assert handle.status is GoalStatus.SUCCEEDED
    assert bench.path()[-1][:2] == pytest.approx([0.5, 0.0])
    assert_smooth(bench.path())


def test_a_goal_at_the_current_position_succeeds_without_a_motion() -> None:
    bench = Bench().up()
    handle = bench.send(to(0.0, 0.0, after_s=0.0))
    bench.cycles_until(lambda: handle.done, 3)
    assert handle.status is GoalStatus.SUCCEEDED
    assert np.abs(bench.path()).max() == 0.0


def test_joints_are_mapped_by_name() -> None:
    bench = Bench().up()
    handle = bench.send(TrajectoryGoal(ARM[::-1], (GoalPoint((0.1, 0.7), 1.0),)))
    bench.cycles_until(lambda: handle.done)
    assert bench.path()[-1][:2] == pytest.approx([0.7, 0.1])


def test_the_command_leads_by_the_lag_of_the_servos() -> None:
    plain, leading = Bench().up(), Bench(arm_parameters(command_lead=0.02)).up()
    for bench in (plain, leading):
        bench.send(to(1.0, 0.0))
        bench.cycle(8)
        assert bench.arm.tracking is not None
        assert bench.arm.tracking.output[0] == bench.path()[-1][0]
    assert leading.path()[-1][0] - plain.path()[-1][0] == pytest.approx(0.02 * plain.velocity[0], rel=0.25)


# Several points


def test_waypoints_are_passed_on_time_without_stopping() -> None:
    bench = Bench().up()
    handle = bench.send(through(*(GoalPoint((0.4 * i, 0.0), float(i)) for i in range(4))))
    seen: dict[float, float] = {}
    for cycle in range(61):
        bench.cycle()
        seen[round(cycle * PERIOD_S, 3)] = bench.velocity[0]
    bench.cycle()
    assert handle.status is GoalStatus.SUCCEEDED
    path = bench.path()[:, 0]
    assert path[19] == pytest.approx(0.4, abs=1e-3)
    assert path[39] == pytest.approx(0.8, abs=1e-3)
    assert min(seen[1.0], seen[2.0]) > 0.3
    assert_smooth(bench.path())


def test_a_goal_ends_at_rest_even_if_its_last_point_has_a_velocity() -> None:
    bench = Bench(arm_parameters(allow_nonzero_velocity_at_trajectory_end=True)).up()
    handle = bench.send(through(GoalPoint((0.5, 0.0), 1.0, velocities=(0.5, 0.0))))
    bench.cycles_until(lambda: handle.done)
    bench.cycle(5)
    assert handle.status is GoalStatus.SUCCEEDED
    assert bench.path()[-1][:2] == pytest.approx([0.5, 0.0])
    assert_smooth(bench.path())


@pytest.mark.parametrize(
    ("points", "delay_s", "expected_s"),
    [
        ((GoalPoint((0.5, 0.0), 2.0),), -1.0, 1.0),
        ((GoalPoint((0.5, 0.0), 1.0),), 1.0, 2.0),
        ((GoalPoint((0.3, 0.0), 0.5), GoalPoint((0.5, 0.0), 2.0)), -1.0, 1.0),
        ((GoalPoint((0.3, 0.0), -1.0), GoalPoint((0.5, 0.0), 1.5)), 0.0, 1.5),
        ((GoalPoint((0.0, 0.0), 0.0), GoalPoint((0.5, 0.0), 1.5)), 0.0, 1.5),
    ],
    ids=["started a second ago", "starts in a second", "first point has passed", "first negative", "first at zero"],
)
def test_stamps_and_points_in_the_past_and_the_future(
    points: tuple[GoalPoint, ...], delay_s: float, expected_s: float
) -> None:
    bench = Bench().up()
    handle = bench.send(through(*points, delay_s=delay_s))
    cycles = bench.cycles_until(lambda: handle.done)
    assert expected_s <= (cycles - 1) * PERIOD_S + 1e-9 <= expected_s + PERIOD_S
    assert outcome(handle) == (GoalStatus.SUCCEEDED, 0, REACHED)
    assert bench.path()[0][0] > 0.0  # The arm moves at once.
    assert_smooth(bench.path())


def test_a_stamp_is_relative_to_the_time_of_its_receipt() -> None:
    bench = Bench().up()
    bench.send(replace(to(0.5, 0.0, after_s=0.5, delay_s=1.0), next_cycle_s=0.04))
    bench.cycle()
    assert bench.arm.tracking is not None
    assert bench.arm.tracking.path.duration_s == pytest.approx(1.46)


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("late_s", [0.0, 0.03, 0.12])
def test_a_stamp_is_kept_if_the_first_cycle_is_late(late_s: float, moving: bool) -> None:
    bench = Bench().up()
    bench.cycle()
    if moving:
        bench.send(to(-0.5, 0.0))
        bench.cycle(5)
    now_s = bench.clock.now()
    stamped = to(0.5, 0.0, after_s=0.5, delay_s=1.0)
    bench.send(replace(stamped, next_cycle_s=PERIOD_S, begins_s=now_s + PERIOD_S))
    bench.clock.sleep_until(now_s + late_s)
    bench.cycle()
    tracking = bench.arm.tracking
    assert tracking is not None
    assert tracking.stamp_s + tracking.path.duration_s == pytest.approx(now_s + 1.5, abs=1e-6)
    start = tracking.path.sample(0.0)
    assert start.position == pytest.approx(tracking.reference.position)
    assert start.velocity == pytest.approx(tracking.reference.velocity) and start.velocity.any() == moving


def test_a_waypoint_that_cannot_be_passed_within_the_limits_is_rejected() -> None:
    """Each point is within its limits. The planner rejects the goal before the arm moves."""
    bench = Bench().up()
    goal = through(GoalPoint((1.95, 0.0), 2.0, velocities=(4.0, 0.0)), GoalPoint((0.0, 0.0), 4.0))
    reason = bench.arm.check(goal)
    assert reason is not None
    assert reason.startswith("shoulder would swing to")


# Replaced goals, cancels, deactivation


def test_a_new_goal_starts_without_a_jump_and_aborts_the_old_goal() -> None:
    bench = Bench().up()
    first = bench.send(to(1.5, 0.0))
    bench.cycle(12)
    second = bench.send(to(-0.5, 0.5, after_s=1.5))
    bench.cycle()
    assert outcome(first) == (GoalStatus.ABORTED, ErrorCode.INVALID_GOAL, PREEMPTED)
    bench.cycles_until(lambda: second.done)
    assert outcome(second) == (GoalStatus.SUCCEEDED, 0, REACHED)
    assert_smooth(bench.path())


def test_the_second_of_two_goals_in_one_cycle_is_executed() -> None:
    bench = Bench().up()
    first, second = bench.send(to(1.0, 0.0)), bench.send(to(-1.0, 0.0))
    bench.cycle()
    assert outcome(first) == (GoalStatus.ABORTED, ErrorCode.INVALID_GOAL, PREEMPTED)
    assert bench.path()[-1][0] < 0.0
    bench.cycles_until(lambda: second.done)
    assert second.status is GoalStatus.SUCCEEDED


def test_a_cancel_decelerates_within_the_limits() -> None:
    bench = Bench().up()
    handle = bench.send(to(1.5, 0.0))
    bench.cycle(12)
    before = bench.path()[-1][0]
    assert bench.velocity[0] > 1.0
    bench.arm.cancel(handle)
    bench.cycle()
    assert not handle.done, "the arm still brakes"
    bench.cycles_until(lambda: handle.done)
    assert outcome(handle) == (GoalStatus.CANCELED, ErrorCode.SUCCESSFUL, "")
    assert bench.path()[-1] == pytest.approx(bench.path()[-2])
    bench.cycle(30)
    assert before < bench.path()[-1][0] < 1.5
    assert bench.path()[-1] == pytest.approx(bench.path()[-2])
    assert_smooth(bench.path())


def test_a_goal_can_be_canceled_in_its_first_cycle() -> None:
    bench = Bench().up()
    handle = bench.send(to(1.0, 0.0))
    bench.arm.cancel(handle)
    bench.cycle(3)
    assert outcome(handle) == (GoalStatus.CANCELED, 0, "")
    assert np.abs(bench.path()).max() == 0.0


def test_a_goal_that_is_canceled_in_its_first_cycle_still_replaces_the_active_goal() -> None:
    """The client that canceled its newest goal expects the arm to stop."""
    bench = Bench().up()
    first = bench.send(to(1.5, 0.0))
    bench.cycle(12)
    before = bench.path()[-1][0]
    second, third = bench.send(to(0.5, 0.0)), bench.send(to(1.0, 0.0))
    assert bench.arm.newest_goal is third
    bench.arm.cancel(third)
    bench.cycles_until(lambda: third.done)
    assert first.status is second.status is GoalStatus.ABORTED and "preempted" in first.error_text
    assert third.status is GoalStatus.CANCELED
    bench.cycle(30)
    assert before < bench.path()[-1][0] < 1.5
    assert bench.path()[-1] == pytest.approx(bench.path()[-2])
    assert_smooth(bench.path())


def test_goals_may_arrive_while_the_loop_searches_for_a_canceled_goal() -> None:
    bench = Bench().up()
    first = bench.send(to(1.0, 0.0))
    inbox = bench.arm._execution._inbox

    class Comes(tuple):  # type: ignore[type-arg]
        """Goal that lets another thread submit a goal while the two are compared."""

        def __getitem__(self, index: Any) -> Any:
            inbox.append(entry)
            return super().__getitem__(index)

    entry = inbox.pop()
    inbox.append(Comes(entry))
    bench.arm.cancel(first)
    bench.cycle(3)
    assert first.status is GoalStatus.CANCELED
    assert bench.arm.running


def test_a_goal_that_cannot_be_joined_is_aborted_and_the_controller_continues(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    bench = Bench().up()
    handle = bench.send(to(1.0, 0.0))
    monkeypatch.setattr(PathPlan, "join", lambda *_: 1 // 0)
    bench.cycle(2)
    assert handle.status is GoalStatus.ABORTED and "ZeroDivisionError" in handle.error_text
    assert bench.arm.running and "Traceback" in caplog.text
    monkeypatch.undo()
    after = bench.send(to(0.5, 0.0))
    bench.cycles_until(lambda: after.done)
    assert after.status is GoalStatus.SUCCEEDED


def test_a_cancel_of_a_finished_goal_has_no_effect() -> None:
    bench = Bench().up()
    old = bench.send(to(0.1, 0.0, after_s=0.5))
    bench.cycles_until(lambda: old.done)
    new = bench.send(to(0.5, 0.0))
    bench.cycle()
    bench.arm.cancel(old)
    bench.cycles_until(lambda: new.done)
    assert old.status is GoalStatus.SUCCEEDED
    assert new.status is GoalStatus.SUCCEEDED


def test_deactivation_aborts_the_active_and_the_waiting_goals() -> None:
    bench = Bench().up()
    under_way = bench.send(to(1.0, 0.0))
    bench.cycle(5)
    waiting = bench.send(to(0.5, 0.0))
    bench.manager.deactivate()
    for handle in (under_way, waiting):
        assert outcome(handle) == (GoalStatus.ABORTED, ErrorCode.INVALID_GOAL, DEACTIVATED)


def test_an_inactive_controller_rejects_goals() -> None:
    bench = Bench()
    text = "Can't accept new action goals. Controller is not running."
    assert bench.arm.check(to(0.1, 0.1)) == text
    bench.up()
    assert bench.arm.check(to(0.1, 0.1)) is None
    bench.manager.deactivate()
    assert bench.arm.check(to(0.1, 0.1)) == text


def test_a_goal_submitted_just_after_deactivation_is_aborted() -> None:
    bench = Bench().up()
    goal = to(0.1, 0.1)
    assert bench.arm.check(goal) is None
    bench.manager.deactivate()
    handle = bench.arm.submit(goal)
    assert outcome(handle) == (GoalStatus.ABORTED, ErrorCode.INVALID_GOAL, DEACTIVATED)
    bench.manager.activate(bench.hardware.read(), bench.loop.command)
    bench.cycle(5)
    assert np.abs(bench.path()).max() == 0.0


# Tolerances


def test_the_path_tolerance_of_the_goal_aborts_and_the_arm_stops() -> None:
    bench = Bench().up()
    bench.hardware.stuck = {"elbow"}
    handle = bench.send(to(1.0, 1.0, path={"elbow": 0.05}))
    bench.cycles_until(lambda: handle.done)
    assert outcome(handle)[:2] == (GoalStatus.ABORTED, ErrorCode.PATH_TOLERANCE_VIOLATED)
    said = r"Aborted due to path tolerance violation: elbow is off by 0\.\d{4}, allowed is 0\.0500"
    assert re.fullmatch(said, handle.error_text)
    bench.cycle(30)
    assert bench.path()[-1][1] == pytest.approx(0.0, abs=1e-9), "who is held is not pressed any further"
    assert bench.path()[-1] == pytest.approx(bench.path()[-2])
    assert_smooth(bench.path())


PATH, GOAL = "path", "goal"


@pytest.mark.parametrize(
    ("asked", "status"),
    [
        ({}, GoalStatus.ABORTED),
        ({"elbow": 0.0}, GoalStatus.ABORTED),
        ({"elbow": 2.0}, GoalStatus.SUCCEEDED),
        ({"elbow": -1.0}, GoalStatus.SUCCEEDED),
        ({"elbow": -2.0}, GoalStatus.ABORTED),
        ({"elbow": 2.0, "foo": 0.1}, GoalStatus.ABORTED),
        ({"shoulder": 0.1}, GoalStatus.ABORTED),
    ],
    ids=["default", "zero: default", "wider", "-1: erased", "-2: default", "unknown joint: default", "other joint"],
)
@pytest.mark.parametrize("kind", [PATH, GOAL])
def test_the_tolerance_of_the_file_applies_unless_the_goal_overrides_it(
    kind: str, asked: dict[str, float], status: GoalStatus
) -> None:
    own = {"elbow": {"trajectory": 0.05}} if kind == PATH else {"elbow": {"goal": 0.05}, "goal_time": 0.2}
    bench = Bench(arm_parameters(constraints=own)).up()
    bench.hardware.stuck = {"elbow"}
    handle = bench.send(to(0.0, 1.0, path=asked) if kind == PATH else to(0.0, 1.0, goal=asked))
    bench.cycles_until(lambda: handle.done)
    assert handle.status is status


def test_without_tolerances_a_stuck_joint_succeeds() -> None:
    bench = Bench().up()
    bench.hardware.stuck = {"elbow"}
    handle = bench.send(to(0.0, 1.0))
    bench.cycles_until(lambda: handle.done)
    assert outcome(handle) == (GoalStatus.SUCCEEDED, 0, REACHED)


def test_without_goal_time_a_goal_outside_its_tolerance_executes_until_canceled() -> None:
    bench = Bench().up()
    bench.hardware.stuck = {"elbow"}
    handle = bench.send(to(0.0, 1.0, goal={"elbow": 0.01}))
    bench.cycle(100)
    assert not handle.done
    bench.arm.cancel(handle)
    bench.cycles_until(lambda: handle.done, 60)
    assert outcome(handle) == (GoalStatus.CANCELED, 0, "")


@pytest.mark.parametrize("goal_time_s", [0.5, 0.0, -2.0], ids=["from the goal", "from the file", "-2: from the file"])
def test_a_goal_is_aborted_after_its_goal_time(goal_time_s: float) -> None:
    bench = Bench(arm_parameters(constraints={"elbow": {"goal": 0.01}, "goal_time": 0.5})).up()
    bench.hardware.stuck = {"elbow"}
    handle = bench.send(to(0.0, 1.0, goal_time_s=goal_time_s))
    bench.cycles_until(lambda: handle.done)
    assert (handle.status, handle.error_code) == (GoalStatus.ABORTED, ErrorCode.GOAL_TOLERANCE_VIOLATED)
    text, off = handle.error_text.split(": ")
    assert off == "elbow is off by 1.0000, allowed is 0.0100"
    text, seconds, unit = text.rsplit(" ", 2)
    assert (text, unit) == ("Aborted due to goal_time_tolerance exceeding by", "seconds")
    assert 0.5 <= float(seconds) <= 0.5 + PERIOD_S + 1e-6  # The time counts from the end of the path.


def test_goal_time_minus_one_erases_the_default() -> None:
    bench = Bench(arm_parameters(constraints={"goal_time": 0.5})).up()
    bench.hardware.stuck = {"elbow"}
    handle = bench.send(to(0.0, 1.0, goal={"elbow": 0.01}, goal_time_s=-1.0))
    bench.cycle(100)
    assert not handle.done


def test_a_late_joint_within_goal_time_succeeds() -> None:
    bench = Bench().up()
    bench.hardware.slow = {"elbow": 0.04}
    handle = bench.send(to(0.0, 1.0, goal={"elbow": 0.01}, goal_time_s=1.0))
    cycles = bench.cycles_until(lambda: handle.done)
    assert outcome(handle) == (GoalStatus.SUCCEEDED, 0, REACHED)
    assert cycles * PERIOD_S > 1.1


# Faults and late cycles


def test_a_lasting_servo_fault_aborts_the_goal_with_its_text() -> None:
    bench = Bench().up()
    handle = bench.send(to(1.0, 0.0))
    bench.cycle(5)
    bench.hardware.faults = {"elbow": JointFault("silent", "elbow: servo 2 does not respond")}
    bench.cycle(FAULT_CYCLES)
    assert outcome(handle) == (GoalStatus.ABORTED, ErrorCode.PATH_TOLERANCE_VIOLATED, "elbow: servo 2 does not respond")
    bench.cycle(20)
    assert_smooth(bench.path())


def test_a_goal_does_not_succeed_with_the_last_position_of_a_silent_servo() -> None:
    bench = Bench().up()
    handle = bench.send(to(0.5, -0.5, after_s=1.0, goal={"elbow": 0.01}))
    bench.cycle(18)
    bench.hardware.faults = {"elbow": JointFault("silent", "elbow: servo 2 does not respond")}
    bench.cycle(FAULT_CYCLES - 2)
    assert not handle.done
    bench.hardware.faults = {}
    bench.cycles_until(lambda: handle.done)
    assert handle.status is GoalStatus.SUCCEEDED


@pytest.mark.parametrize("canceled", [True, False], ids=["a cancel", "a violated path"])
def test_a_stopping_goal_ends_even_if_its_servos_become_silent(
    canceled: bool, caplog: pytest.LogCaptureFixture
) -> None:
    bench = Bench().up()
    handle = bench.send(to(1.0, 1.0, after_s=2.0, path={"shoulder": 0.1}))
    bench.cycle(20 if canceled else 12)
    if canceled:
        bench.arm.cancel(handle)
        bench.cycle()
    else:
        bench.hardware.stuck = {"shoulder"}
        bench.cycles_until(lambda: "path tolerance violation" in caplog.text)
    bench.hardware.faults = {name: JointFault("silent", f"{name} does not respond") for name in ARM}
    assert bench.cycles_until(lambda: handle.done) <= FAULT_CYCLES
    assert handle.status is (GoalStatus.CANCELED if canceled else GoalStatus.ABORTED)
    assert "shoulder does not respond; elbow does not respond" in caplog.text


def test_a_short_servo_fault_does_not_affect_a_goal() -> None:
    bench = Bench().up()
    handle = bench.send(to(1.0, 0.0))
    for _ in range(5):
        bench.hardware.faults = {"elbow": JointFault("silent", "elbow: servo 2 does not respond")}
        bench.cycle(FAULT_CYCLES - 1)
        bench.hardware.faults = {}
        bench.cycle()
    bench.cycles_until(lambda: handle.done)
    assert handle.status is GoalStatus.SUCCEEDED


def test_an_unmeasured_joint_does_not_violate_the_path_tolerance() -> None:
    """The reference continues to move while the last known position stays constant."""
    bench = Bench().up()
    handle = bench.send(to(1.0, 1.0, path={"elbow": 0.15}))
    bench.cycle(6)
    bench.hardware.faults = {"elbow": JointFault("silent", "elbow: servo 2 does not respond")}
    bench.hardware.stuck = {"elbow"}
    bench.cycle(FAULT_CYCLES - 1)
    assert not handle.done
    bench.hardware.faults = {}
    bench.cycles_until(lambda: handle.done, 60)
    assert (handle.status, handle.error_code) == (GoalStatus.ABORTED, ErrorCode.PATH_TOLERANCE_VIOLATED)


def test_a_fault_of_another_controllers_joint_does_not_affect_a_goal() -> None:
    bench = Bench().up()
    bench.hardware.faults = {"finger": JointFault("silent", "finger: servo 7 does not respond")}
    handle = bench.send(to(1.0, 0.0))
    bench.cycles_until(lambda: handle.done)
    assert handle.status is GoalStatus.SUCCEEDED


def test_a_fault_aborts_a_waiting_goal() -> None:
    bench = waiting_bench()
    bench.hand.submit([0.05])
    handle = bench.send(to(1.0, 0.0))
    bench.hardware.faults = {"elbow": JointFault("silent", "elbow: servo 2 does not respond")}
    bench.cycle(FAULT_CYCLES)
    assert handle.status is GoalStatus.ABORTED
    assert np.abs(bench.path()[:, :2]).max() == 0.0


@pytest.mark.parametrize("late_s", [0.02, 0.5, 30.0])
def test_a_late_cycle_does_not_leap(late_s: float) -> None:
    bench = Bench().up()
    handle = bench.send(to(1.9, 0.0, after_s=1.5))
    bench.cycle(15)
    bench.clock.sleep_until(bench.clock.now() + late_s)
    bench.cycles_until(lambda: handle.done)
    assert handle.status is GoalStatus.SUCCEEDED
    step = np.abs(np.diff(bench.path()[:, 0])).max()
    assert step <= ARM_LIMITS.velocity * PERIOD_S + 1e-9
    assert step <= 2.0 * 2.1 * PERIOD_S  # at most two periods at the velocity of this motion


# wait_for


def waiting_bench(timeout_s: float = 1.5) -> Bench:
    bench = Bench(arm_parameters(wait_for=["hand"], wait_for_timeout=timeout_s)).up()
    bench.hardware.slow = {"finger": 0.005}
    return bench


def cycles_before_it_moves(bench: Bench) -> int:
    return bench.cycles_until(lambda: len(bench.path()) > 0 and np.abs(bench.path()[-1][:2]).max() > 0.0)


def test_a_goal_does_not_wait_for_a_settled_hand() -> None:
    bench = waiting_bench()
    bench.send(to(1.0, 0.0))
    assert cycles_before_it_moves(bench) == 1


def test_a_goal_waits_until_the_fingers_have_arrived() -> None:
    bench = waiting_bench()
    bench.hand.submit([0.05])
    handle = bench.send(to(1.0, 0.0))
    cycles_before_it_moves(bench)
    assert bench.hardware.read().position[2] == pytest.approx(0.05, abs=0.002)
    bench.cycles_until(lambda: handle.done)
    assert outcome(handle) == (GoalStatus.SUCCEEDED, 0, REACHED)


def test_a_goal_waits_until_the_fingers_have_stalled_on_an_object() -> None:
    bench = waiting_bench(timeout_s=10.0)
    bench.hand.submit([0.05])
    bench.send(to(1.0, 0.0))
    bench.cycle(5)
    bench.hardware.stuck = {"finger"}
    assert cycles_before_it_moves(bench) <= 5


@pytest.mark.parametrize("cycles_later", [0, 1])
def test_a_goal_waits_for_a_hand_command_that_arrives_just_after_it(cycles_later: int) -> None:
    bench = waiting_bench()
    handle = bench.send(to(1.0, 0.0))
    bench.cycle(cycles_later)
    bench.hand.submit([0.05])
    bench.cycles_until(lambda: abs(bench.hardware.read().position[2] - 0.05) < 0.002)
    assert np.abs(bench.path()[:-1, 0]).max() < 0.035  # The arm stops at once, within its limits.
    bench.cycles_until(lambda: handle.done)
    assert outcome(handle) == (GoalStatus.SUCCEEDED, 0, REACHED)
    assert_smooth(bench.path())


def test_a_stream_of_trajectories_on_the_topic_does_not_wait() -> None:
    bench = waiting_bench()
    bench.hand.submit([0.05])
    bench.send(replace(to(1.0, 0.0), from_topic=True))
    assert cycles_before_it_moves(bench) == 1
    bench.send(replace(to(1.0, 0.0), from_topic=True))
    bench.cycle(2)
    bench.hand.submit([0.0])
    bench.cycle(2)
    moved = np.diff(bench.path()[:, 0])
    assert (moved[1:] > 0.0).all()


def test_a_hand_that_moves_later_does_not_stop_the_arm() -> None:
    bench = waiting_bench()
    handle = bench.send(to(1.0, 0.0))
    bench.cycle(3)
    bench.hand.submit([0.05])
    assert bench.cycles_until(lambda: handle.done) < 25


def test_a_wait_times_out_with_the_name_of_the_controller(caplog: pytest.LogCaptureFixture) -> None:
    bench = waiting_bench(timeout_s=0.5)
    bench.hardware.slow = {"finger": 0.06 * HAND_LIMITS.velocity * PERIOD_S}
    bench.hand.submit([0.05])
    bench.send(to(1.0, 0.0))
    cycles = cycles_before_it_moves(bench)
    assert 10 <= cycles <= 12
    assert "starting the goal although hand has not settled" in caplog.text


def test_a_new_goal_replaces_a_waiting_goal() -> None:
    bench = waiting_bench()
    bench.hand.submit([0.05])
    first = bench.send(to(1.0, 0.0))
    bench.cycle(3)
    second = bench.send(to(-1.0, 0.0))
    bench.cycle()
    assert outcome(first) == (GoalStatus.ABORTED, ErrorCode.INVALID_GOAL, PREEMPTED)
    bench.cycles_until(lambda: second.done)
    assert second.status is GoalStatus.SUCCEEDED
    assert bench.path()[:, 0].max() == 0.0


def test_a_waiting_goal_can_be_canceled() -> None:
    bench = waiting_bench()
    bench.hand.submit([0.05])
    handle = bench.send(to(1.0, 0.0))
    bench.cycle(3)
    bench.arm.cancel(handle)
    bench.cycle(40)
    assert outcome(handle) == (GoalStatus.CANCELED, 0, "")
    assert np.abs(bench.path()[:, :2]).max() == 0.0


def test_a_goal_that_must_wait_during_a_motion_decelerates_within_the_limits() -> None:
    bench = waiting_bench()
    bench.send(to(1.5, 0.0))
    bench.cycle(12)
    bench.hand.submit([0.05])
    handle = bench.send(to(-0.5, 0.0))
    bench.cycles_until(lambda: handle.done)
    assert handle.status is GoalStatus.SUCCEEDED
    assert_smooth(bench.path())


def test_the_waiting_time_of_a_stamped_goal_is_not_added_to_its_end() -> None:
    bench = waiting_bench()
    bench.hand.submit([0.05])
    handle = bench.send(to(0.5, 0.0, after_s=1.0, delay_s=1.0))
    cycles = bench.cycles_until(lambda: handle.done)
    assert 2.0 <= (cycles - 1) * PERIOD_S + 1e-9 <= 2.0 + PERIOD_S


def test_a_goal_does_not_wait_for_a_missing_controller(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.WARNING)
    bench = Bench(arm_parameters(wait_for=["nobody"])).up()
    bench.send(to(1.0, 0.0))
    assert cycles_before_it_moves(bench) == 1
    assert caplog.text == ""


def test_a_slow_observer_gets_every_cycle_once() -> None:
    bench = Bench().up()
    states: list[JointState] = []
    bench.loop.on_cycle = states.append
    bench.send(to(1.0, 0.0))
    bench.cycle(4)
    seen = [list(bench.arm.tracked(state.stamp_s)) for state in states]
    assert [[tracking.stamp_s for tracking in cycle] for cycle in seen] == [[state.stamp_s] for state in states]
    assert [cycle[0].output[0] for cycle in seen] == list(bench.path()[:, 0])
    assert seen[-1] == [bench.arm.tracking]
    assert [list(bench.arm.tracked(state.stamp_s)) for state in states] == [[], [], [], []]


def test_cycles_that_an_observer_skips_are_dropped_and_later_cycles_are_kept() -> None:
    bench = Bench().up()
    states: list[JointState] = []
    bench.loop.on_cycle = states.append
    bench.cycle(3)
    bench.manager.deactivate()
    bench.cycle()
    assert [tracking.stamp_s for tracking in bench.arm.tracked(states[1].stamp_s)] == [states[1].stamp_s]
    assert [tracking.stamp_s for tracking in bench.arm.tracked(states[2].stamp_s)] == [states[2].stamp_s]
    assert list(bench.arm.tracked(states[3].stamp_s)) == []
