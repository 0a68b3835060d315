"""Test the effect of parameters and topics on trajectories, cycle by cycle."""

import math
import random
from dataclasses import replace

import numpy as np
import pytest

from controller.action_goals import DEACTIVATED, PREEMPTED, GoalStatus
from controller.trajectory.goal import GoalHandle, GoalPoint, TrajectoryGoal
from controller.trajectory.goal_result import PREEMPTED_BY_TOPIC, TIMED_OUT, ErrorCode
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from controller.trajectory.sampler import shorter_way
from hal.types import FloatArray, JointLimits, JointState
from tests.controller.bench import ARM, ARM_LIMITS, PERIOD_S, Bench, arm_parameters, through, to

METHODS = ("splines", "ruckig", "none")


def bench_with(**said: object) -> Bench:
    return Bench(arm_parameters(**said)).up()


def outcome(handle: GoalHandle) -> tuple[GoalStatus, int, str]:
    return handle.status, handle.error_code, handle.error_text


def finish(bench: Bench, handle: GoalHandle) -> int:
    return bench.cycles_until(lambda: handle.done)


def speeds(path: FloatArray) -> FloatArray:
    return np.diff(path[:, :2], axis=0) / PERIOD_S


def assert_gentle(path: FloatArray) -> None:
    """Check that a velocity stays within its limit and changes within the acceleration limit."""
    assert np.abs(speeds(path)).max() <= ARM_LIMITS.velocity * (1 + 1e-6)
    assert np.abs(np.diff(speeds(path), axis=0)).max() <= ARM_LIMITS.acceleration * PERIOD_S * (1 + 1e-6)


# Methods


@pytest.mark.parametrize("method", METHODS)
def test_every_interpolation_method_arrives_on_time(method: str) -> None:
    bench = bench_with(interpolation_method=method)
    handle = bench.send(through(GoalPoint((0.5, 0.1), 1.0), GoalPoint((0.8, -0.5), 2.0)))
    cycles = finish(bench, handle)
    assert 2.0 <= (cycles - 1) * PERIOD_S + 1e-9 <= 2.0 + PERIOD_S
    assert outcome(handle)[:2] == (GoalStatus.SUCCEEDED, 0)
    bench.cycle(20)
    assert bench.path()[-1][:2] == pytest.approx((0.8, -0.5))
    assert np.abs(speeds(bench.path())).max() <= ARM_LIMITS.velocity * (1 + 1e-6)


def test_splines_with_positions_only_move_at_constant_speed() -> None:
    bench = bench_with(interpolation_method="splines")
    handle = bench.send(to(1.0, -0.5, after_s=1.0))
    finish(bench, handle)
    assert speeds(bench.path())[0:19, 0] == pytest.approx(np.full(19, 1.0))
    assert bench.path()[0][0] == pytest.approx(0.05)


def test_splines_that_are_too_fast_are_stretched_and_report_it() -> None:
    bench = bench_with(interpolation_method="splines")
    handle = bench.send(to(1.6, 0.0, after_s=0.1))
    finish(bench, handle)
    assert handle.error_text.endswith("The limits stretched the motion from 0.10 s to 0.40 s.")
    assert np.abs(speeds(bench.path())).max() <= ARM_LIMITS.velocity * (1 + 1e-6)


def test_a_spline_with_zero_duration_does_not_leap() -> None:
    bench = bench_with(interpolation_method="splines")
    handle = bench.send(to(1.0, 0.0, after_s=0.0))
    assert finish(bench, handle) >= 5
    assert np.abs(speeds(bench.path())).max() <= ARM_LIMITS.velocity * (1 + 1e-6)


def test_accelerations_without_velocities_are_ignored() -> None:
    """ros2_control holds its position until the end, and then jumps to the goal."""
    paths = []
    for accelerations in ((), (1.0, 1.0)):
        bench = bench_with(interpolation_method="splines")
        finish(bench, bench.send(through(GoalPoint((0.5, 0.0), 1.0, accelerations=accelerations))))
        paths.append(bench.path())
    assert paths[0] == pytest.approx(paths[1])


@pytest.mark.parametrize("count", [60, 500])
def test_a_planners_trajectory_of_many_points_is_followed(count: int) -> None:
    bench = bench_with()
    points = (GoalPoint((math.sin(i * 0.02), 0.0), i * 0.02 + 0.02, (math.cos(i * 0.02), 0.0)) for i in range(1, count))
    handle = bench.send(through(*points, GoalPoint((math.sin(count * 0.02), 0.0), count * 0.02 + 0.02)))
    cycles = finish(bench, handle)
    assert handle.status is GoalStatus.SUCCEEDED
    assert cycles * PERIOD_S <= 1.1 * count * 0.02 + 0.5
    assert_gentle(bench.path())


# Goals


@pytest.mark.parametrize("method", METHODS)
def test_joints_that_a_goal_does_not_name_hold(method: str) -> None:
    bench = bench_with(allow_partial_joints_goal=True, interpolation_method=method)
    finish(bench, bench.send(to(0.3, 0.4, after_s=0.5)))
    bench.cycle(5)
    finish(bench, bench.send(TrajectoryGoal(("elbow",), (GoalPoint((0.1,), 0.5),))))
    bench.cycle(5)
    assert bench.path()[-1][:2] == pytest.approx((0.3, 0.1))


def test_a_moving_joint_that_a_goal_does_not_name_stops_without_reversing() -> None:
    bench = bench_with(allow_partial_joints_goal=True)
    bench.send(to(1.5, 0.0))
    bench.cycle(12)
    finish(bench, bench.send(TrajectoryGoal(("elbow",), (GoalPoint((0.5,), 1.0),))))
    assert_gentle(bench.path())
    assert speeds(bench.path())[:, 0].min() > -0.05
    assert bench.path()[-1][1] == pytest.approx(0.5)


def test_velocities_without_positions_are_integrated_if_allowed() -> None:
    bench = bench_with(allow_integration_in_goal_trajectories=True, interpolation_method="splines")
    goal = through(
        GoalPoint((), 1.0, velocities=(0.4, 0.0)),
        GoalPoint((), 2.0, velocities=(0.4, 0.0)),
        GoalPoint((), 3.0, velocities=(0.0, 0.0)),
    )
    handle = bench.send(goal)
    finish(bench, handle)
    assert handle.status is GoalStatus.SUCCEEDED
    assert bench.path()[-1][0] == pytest.approx(0.2 + 0.4 + 0.2)


def test_integrated_positions_are_compared_with_the_limits() -> None:
    bench = bench_with(allow_integration_in_goal_trajectories=True)
    goal = through(GoalPoint((), 1.0, velocities=(3.0, 0.0)), GoalPoint((), 2.0, velocities=(0.0, 0.0)))
    assert bench.arm.check(goal) == ("shoulder would go to 3.0000 at point #1, outside its limits -2.0000 to 2.0000")


def test_a_continuous_joint_moves_the_shorter_way_around() -> None:
    limits = [JointLimits(-math.inf, math.inf, 4.0, 12.0, 120.0), ARM_LIMITS]
    arm = JointTrajectoryController("arm", arm_parameters(), limits, ARM, lambda name: True)
    position = np.array([3.0, 0.0])
    arm.activate(JointState(0.0, position, np.zeros(2), np.zeros(2)), position)
    goal = TrajectoryGoal(ARM, (GoalPoint((-3.0, 0.0), 1.0),))
    assert arm.check(goal) is None
    handle = arm.submit(goal)
    for cycle in range(1, 40):
        state = JointState(cycle * PERIOD_S, arm.command, np.zeros(2), np.zeros(2))
        arm.update(state, cycle * PERIOD_S, PERIOD_S)
    assert handle.status is GoalStatus.SUCCEEDED
    assert arm.command[0] == pytest.approx(math.tau - 3.0)


def test_the_error_of_a_continuous_joint_is_the_shorter_way_around() -> None:
    assert shorter_way(np.array([6.2, 6.2]), [0]) == pytest.approx((6.2 - math.tau, 6.2))


def test_a_blocked_continuous_joint_is_relieved_the_shorter_way_around() -> None:
    limits = [JointLimits(-math.inf, math.inf, 4.0, 12.0, 120.0), ARM_LIMITS]
    arm = JointTrajectoryController("arm", arm_parameters(), limits, ARM, lambda name: True)
    held = np.array((3.0, 0.0))
    arm.activate(JointState(0.0, held - (math.tau, 0.0), np.zeros(2), np.zeros(2)), held)  # one turn apart
    goal = to(4.0, 0.0, path={"shoulder": 0.2})
    handle = arm.submit(goal)
    commands = []
    for cycle in range(1, 60):
        state = JointState(cycle * PERIOD_S, held - (math.tau, 0.0), np.zeros(2), np.zeros(2))
        arm.update(state, cycle * PERIOD_S, PERIOD_S)
        commands.append(arm.command[0])
    assert handle.status is GoalStatus.ABORTED
    assert min(commands) > 2.9 and commands[-1] == pytest.approx(3.0)


# Cancel, timeout, topic


def test_a_cancel_can_hold_the_measured_position_as_in_ros2_control() -> None:
    bench = bench_with(constraints={"decelerate_on_cancel": False})
    bench.hardware.slow = {"shoulder": 0.02}
    handle = bench.send(to(1.0, 0.0))
    bench.cycle(10)
    bench.arm.cancel(handle)
    bench.cycle(30)
    assert outcome(handle) == (GoalStatus.CANCELED, 0, "")
    assert bench.path()[-1][0] == pytest.approx(9 * 0.02)
    assert np.abs(speeds(bench.path())).max() <= ARM_LIMITS.velocity * (1 + 1e-6)


def test_a_cancel_applies_the_configured_deceleration() -> None:
    stops = []
    for limit in (0.0, 3.0, 100.0):
        bench = bench_with(constraints={"shoulder": {"max_deceleration_on_cancel": limit}})
        handle = bench.send(to(1.5, 0.0))
        bench.cycle(10)
        bench.arm.cancel(handle)
        bench.cycle(40)
        stops.append(bench.path()[-1][0])
        assert_gentle(bench.path())
    assert stops[1] > stops[0] + 0.1
    assert stops[2] == pytest.approx(stops[0])  # never a higher deceleration than the joint's own limit


@pytest.mark.parametrize(
    "said",
    [
        {"interpolation_method": "splines"},
        {"constraints": {"shoulder": {"max_deceleration_on_cancel": 0.5}}},
    ],
    ids=["too fast to stop", "too gentle"],
)
def test_a_stop_near_a_limit_ends_there_and_the_joint_can_move_again(said: dict[str, object]) -> None:
    bench = bench_with(**said)
    handle = bench.send(to(2.0, 0.0, after_s=0.6))
    bench.cycle()
    bench.cycles_until(lambda: bench.path()[-1][0] > 1.6)
    bench.arm.cancel(handle)
    bench.cycle(40)
    assert bench.arm.tracking is not None
    assert bench.arm.tracking.reference.position[0] <= 2.0
    assert bench.arm.tracking.output == pytest.approx(bench.path()[-1][:2])  # The safety gate changes no command.
    handle = bench.send(to(0.0, 0.0))
    finish(bench, handle)
    assert handle.status is GoalStatus.SUCCEEDED


def test_a_command_timeout_holds_the_measured_position() -> None:
    bench = bench_with(cmd_timeout=0.5)
    bench.hardware.stuck = {"elbow"}
    handle = bench.send(to(0.1, 0.5, goal={"elbow": 0.01}))
    finish(bench, handle)
    assert outcome(handle) == (GoalStatus.ABORTED, ErrorCode.GOAL_TOLERANCE_VIOLATED, TIMED_OUT.text)
    bench.cycle(20)
    assert bench.path()[-1][:2] == pytest.approx((0.1, 0.0))


def test_a_command_timeout_shorter_than_the_goal_time_is_ignored() -> None:
    bench = bench_with(cmd_timeout=0.2, constraints={"goal_time": 0.5})
    bench.hardware.stuck = {"elbow"}
    handle = bench.send(to(0.1, 0.5, goal={"elbow": 0.01}))
    finish(bench, handle)
    assert handle.error_text.startswith("Aborted due to goal_time_tolerance")


def test_a_trajectory_on_the_topic_aborts_the_goal_with_a_text() -> None:
    bench = bench_with()
    handle = bench.send(to(1.0, 0.0))
    bench.cycle(5)
    bench.send(replace(to(0.0, 0.5), from_topic=True))
    bench.cycle()
    assert outcome(handle) == (GoalStatus.ABORTED, ErrorCode.INVALID_GOAL, PREEMPTED_BY_TOPIC)
    bench.cycle(40)
    assert bench.path()[-1][:2] == pytest.approx((0.0, 0.5))
    assert_gentle(bench.path())


def test_a_goal_replaces_a_trajectory_from_the_topic() -> None:
    bench = bench_with()
    topic = bench.send(replace(to(0.0, 0.5), from_topic=True))
    bench.cycle(5)
    handle = bench.send(to(0.5, 0.0))
    finish(bench, handle)
    assert handle.status is GoalStatus.SUCCEEDED
    assert topic.error_text == PREEMPTED


@pytest.mark.parametrize("refused", [to(9.0, 0.0), TrajectoryGoal(ARM, ()), TrajectoryGoal(("elbow",), ())])
def test_a_rejected_goal_does_not_affect_the_active_goal(refused: TrajectoryGoal) -> None:
    bench = bench_with()
    handle = bench.send(to(1.0, 0.0))
    bench.cycle(5)
    assert bench.arm.check(refused) is not None
    finish(bench, handle)
    assert handle.status is GoalStatus.SUCCEEDED


# Speed scaling


def test_a_goal_takes_twice_as_long_at_half_speed() -> None:
    bench = bench_with()
    bench.arm.scaling.ask(0.5)
    handle = bench.send(to(1.0, 0.0))
    cycles = finish(bench, handle)
    assert 2.0 <= (cycles - 1) * PERIOD_S + 1e-9 <= 2.0 + 2 * PERIOD_S
    assert bench.arm.tracking is not None and bench.arm.tracking.speed_scaling_factor == 0.5


@pytest.mark.parametrize("method", ["ruckig", "splines"])
@pytest.mark.parametrize("asked", [0.0, 0.3])
def test_a_change_of_speed_keeps_the_limits_and_the_goal_arrives(asked: float, method: str) -> None:
    bench = bench_with(interpolation_method=method)
    velocities = (0.0, 0.0)
    handle = bench.send(through(GoalPoint((1.8, 0.0), 1.5, velocities, (0.0, 0.0))))
    for cycles, factor in ((12, asked), (25, 1.0)):
        bench.cycle(cycles)
        bench.arm.scaling.ask(factor)
    assert not handle.done
    finish(bench, handle)
    assert handle.status is GoalStatus.SUCCEEDED
    assert bench.path()[-1][0] == pytest.approx(1.8)
    assert_gentle(bench.path())


def test_a_pause_stops_the_joints() -> None:
    bench = bench_with()
    handle = bench.send(to(1.0, 0.0))
    bench.cycle(10)
    bench.arm.scaling.ask(0.0)
    bench.cycle(30)
    assert bench.path()[-1][0] == bench.path()[-10][0]
    assert not handle.done


@pytest.mark.parametrize("factor", [0.0, 0.3])
def test_cancels_and_new_goals_at_reduced_speed_keep_the_limits(factor: float) -> None:
    for cancel in (True, False):
        bench = bench_with()
        handle = bench.send(to(1.5, 0.0))
        bench.cycle(10)
        bench.arm.scaling.ask(factor)
        bench.cycle(3)
        if cancel:
            bench.arm.cancel(handle)
        else:
            bench.send(to(-0.5, 0.5))
        bench.cycle(30)
        assert_gentle(bench.path())
        assert handle.done
        if cancel or not factor:
            assert bench.path()[-1] == pytest.approx(bench.path()[-2])


# Queries


def test_the_reference_can_be_read_at_another_time() -> None:
    bench = bench_with(interpolation_method="splines")
    bench.cycle()
    tracking = bench.arm.tracking
    assert tracking is not None
    assert tracking.at(0.0)[1] is False  # The controller holds the position.
    bench.send(to(1.0, 0.0))
    bench.cycle(11)
    tracking = bench.arm.tracking
    assert tracking is not None
    state, under_way = tracking.at(0.2)
    assert under_way and state.position[0] == pytest.approx(0.7)
    assert [tracking.at(later_s)[1] for later_s in (-0.6, -0.4, 0.4, 0.6)] == [False, True, True, False]
    bench.cycle(20)
    tracking = bench.arm.tracking
    assert tracking is not None and tracking.at(0.0)[1] is False


def test_parameters_apply_from_the_next_goal_on() -> None:
    bench = bench_with()
    part = TrajectoryGoal(("elbow",), (GoalPoint((0.1,), 0.5),))
    assert bench.arm.check(part) is not None
    bench.arm.reconfigure(arm_parameters(allow_partial_joints_goal=True))
    assert bench.arm.check(part) is None


def test_every_joint_has_constraint_parameters() -> None:
    constraints = arm_parameters(constraints={"elbow": {"goal": 0.1}}).constraints
    assert set(constraints.by_joint()) == set(ARM)
    assert constraints.by_joint()["elbow"].goal == 0.1


def test_lost_hardware_aborts_the_goal_with_its_reason() -> None:
    bench = bench_with()
    handle = bench.send(to(1.0, 0.0))
    bench.cycle(3)
    bench.arm.deactivate("the port was unplugged")
    assert handle.error_text == f"{DEACTIVATED} the port was unplugged"
    assert bench.arm.tracking is None


def test_a_reactivated_controller_starts_at_the_current_positions() -> None:
    bench = bench_with()
    bench.send(to(1.0, 0.0))
    bench.cycle(10)
    bench.manager.deactivate()
    somewhere = np.array([-0.4, 0.2])
    bench.arm.activate(bench.hardware.read(), somewhere)
    bench.arm.update(bench.hardware.read(), bench.clock.now() + PERIOD_S, PERIOD_S)
    assert bench.arm.command == pytest.approx(somewhere)


# Random sequences


def restless_goal(dice: random.Random) -> TrajectoryGoal:
    """Return a random goal: one or several points, for some of the joints, or with many points as from a planner."""
    kind = dice.randint(0, 3)
    if kind == 0:
        return TrajectoryGoal(ARM[1:], (GoalPoint((dice.uniform(-2.0, 2.0),), dice.uniform(0.0, 2.0)),))
    if kind == 1:
        way, apart_s = dice.uniform(-1.5, 1.5), dice.uniform(0.01, 0.1)
        shares = [(1.0 - math.cos(math.pi * i / 80)) / 2.0 for i in range(1, 81)]
        return through(*(GoalPoint((way * share, 0.0), apart_s * (i + 1)) for i, share in enumerate(shares)))
    times = sorted(dice.uniform(0.05, 4.0) for _ in range(dice.randint(1, 4)))
    return through(*(GoalPoint((dice.uniform(-2.0, 2.0), dice.uniform(-2.0, 2.0)), t) for t in times))


@pytest.mark.parametrize("seed", range(12))
def test_no_sequence_of_goals_exceeds_the_acceleration_limit(seed: int) -> None:
    dice = random.Random(seed)
    bench = bench_with(allow_partial_joints_goal=True, command_lead=0.013)
    handles: list[GoalHandle] = []
    for _ in range(20):
        goal = restless_goal(dice)
        if dice.random() < 0.2 and handles:
            bench.arm.cancel(handles[-1])
        elif bench.arm.check(goal) is None:
            handles.append(bench.arm.submit(goal))
        bench.cycle(dice.randint(1, 15))
    assert len(handles) > 5
    changes = np.abs(np.diff(speeds(bench.path()), axis=0)).max() / PERIOD_S
    assert changes <= ARM_LIMITS.acceleration * 1.01  # the lead of 13 ms is not part of the plan
