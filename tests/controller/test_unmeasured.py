"""Test that a goal waits after more than one cycle without a measurement, then continues from rest."""

import numpy as np
import pytest

from controller.action_goals import GoalStatus
from controller.motion import Kinematics, motion_to
from controller.trajectory.goal import GoalHandle
from controller.trajectory.sampler import TrajectorySampler
from controller.trajectory.standstill import restart
from controller.unmeasured import Unmeasured
from hal.types import FloatArray, JointFault
from tests.controller.bench import ARM, ARM_LIMITS, PERIOD_S, Bench, arm_parameters, to

STEP_S = 0.05
SILENT, LIMP = JointFault("silent", ""), JointFault("no_torque", "")


@pytest.mark.parametrize(
    ("cycles", "steps"),
    [
        ([{"a": SILENT, "b": SILENT}, {}], [1, 1]),
        ([{"a": SILENT, "b": SILENT}] * 3 + [{}, {}], [1, 0, 0, 1, 1]),
        ([{"a": SILENT}] * 3, [1, 1, 1]),
        ([{"a": SILENT, "b": LIMP}] * 3, [1, 1, 1]),
        ([{"a": SILENT, "b": SILENT, "c": LIMP}] * 2, [1, 0]),
    ],
    ids=["one lost answer", "a stall", "one silent joint", "a limp one is measured", "others count for nothing"],
)
def test_a_goal_waits_from_the_second_cycle_without_a_measurement(
    cycles: list[dict[str, JointFault]], steps: list[int]
) -> None:
    unmeasured = Unmeasured(("a", "b"))
    assert [unmeasured.step_s(faults, STEP_S) for faults in cycles] == [STEP_S * step for step in steps]


def test_a_goal_waits_for_a_limited_time_until_the_joints_reach_the_command() -> None:
    unmeasured, there = Unmeasured(("a",)), False
    steps = [unmeasured.step_s(faults, 0.125, lambda: there) for faults in [{"a": SILENT}] * 3 + [{}] * 5]
    assert steps == [0.125] + [0.0] * 6 + [0.125], "half a second"
    for _ in range(3):
        unmeasured.step_s({"a": SILENT}, STEP_S)
    assert unmeasured.step_s({}, STEP_S, lambda: there) == 0.0
    there = True
    assert unmeasured.step_s({}, STEP_S, lambda: there) == STEP_S


def stalled(bench: Bench, cycles: int) -> FloatArray:
    """Stall the bus for a given number of cycles. Return the command (n,) at which the joints are at rest."""
    bench.hardware.faults = {joint: JointFault("silent", f"{joint}: no answer") for joint in ARM}
    bench.cycle(cycles)
    bench.hardware.faults = {}
    return bench.path()[-1, :2]


def under_way(bench: Bench) -> GoalHandle:
    """Start a goal and run until both joints move up at full speed."""
    handle = bench.send(to(1.8, 0.9, after_s=1.2))
    bench.cycle(12)
    return handle


def gone_on(bench: Bench, cycles: int = 400) -> FloatArray:
    """Return the commanded velocities (k, 2) of the arm from now on."""
    begins = len(bench.path()) - 2
    bench.cycle(cycles)
    return np.diff(bench.path()[begins:, :2], axis=0) / PERIOD_S


@pytest.mark.parametrize("silent", [2, 4, 6])
@pytest.mark.parametrize("lead_s", [0.0, 0.04, 0.1])
@pytest.mark.parametrize("method", ["ruckig", "splines"])
def test_a_goal_continues_from_rest_at_the_last_command_after_a_stall(method: str, lead_s: float, silent: int) -> None:
    bench = Bench(arm_parameters(command_lead=lead_s, interpolation_method=method)).up()
    handle = under_way(bench)
    stalled(bench, silent)
    velocity = gone_on(bench, 10)
    assert not velocity[0].any() and velocity.min() >= -1e-3
    assert velocity[1:, 0].max() > 1.0
    if lead_s < 0.1:  # With a long lead, the initial velocity causes steps of the command, as after a pause.
        assert np.abs(np.diff(velocity, axis=0)).max() <= ARM_LIMITS.acceleration * PERIOD_S * (1.0 + 1e-6)
    bench.cycles_until(lambda: handle.done)
    assert handle.status is GoalStatus.SUCCEEDED
    assert bench.path()[-1, :2] == pytest.approx((1.8, 0.9), abs=1e-3)


def led(sampler: TrajectorySampler, cycles: int = 80) -> FloatArray:
    """Run cycles and return the commands (k, 2)."""
    commands = [sampler.ahead(PERIOD_S)]
    for _ in range(cycles):
        sampler.advance(PERIOD_S)
        commands.append(sampler.ahead(PERIOD_S))
    return np.array(commands)


@pytest.mark.parametrize("at_s", [0.2, 0.5, 0.9, 1.3, 1.95])
def test_a_path_continues_from_each_joints_position_despite_different_lags(at_s: float) -> None:
    limits, lags = [ARM_LIMITS] * 2, np.array(((0.02, 15.0, 0.001), (0.08, np.inf, 0.004))).T
    start, end = (Kinematics.at_rest(np.array(position)) for position in ((-1.9, 0.0), (1.9, -1.0)))
    undisturbed, sampler = (TrajectorySampler(limits, 1.0, lags) for _ in range(2))
    for one in (undisturbed, sampler):
        one.follow(motion_to(start, end, limits, 2.0), start)
        one.advance(at_s)
    sent = sampler.ahead(PERIOD_S)
    restart(sampler, sent)
    assert at_s <= sampler.elapsed_s <= at_s + 0.25
    commands = led(sampler)
    assert commands[0] == pytest.approx(sent, abs=1e-9)
    steps, ordinary = (np.diff(one, axis=0) * (1.0, -1.0) for one in (commands, led(undisturbed)))
    assert (steps.min(axis=0) >= np.minimum(ordinary.min(axis=0), -1e-3)).all(), "beyond its end, and back, as ever"
    assert steps.max() <= ARM_LIMITS.velocity * PERIOD_S
    assert np.abs(steps[0]).max() <= ARM_LIMITS.acceleration * PERIOD_S**2
    assert commands[-1] == pytest.approx(end.position, abs=1e-3)


@pytest.mark.parametrize("first", ["cancel", "stall"])
def test_a_canceled_goal_does_not_move_after_a_stall(first: str) -> None:
    bench = Bench(arm_parameters(command_lead=0.04)).up()
    handle = under_way(bench)
    if first == "cancel":
        bench.arm.cancel(handle)
        bench.cycle()
    stalled(bench, 3)
    bench.hardware.faults = {joint: JointFault("silent", "") for joint in ARM}
    bench.arm.cancel(handle)
    stalled(bench, 3)
    assert np.abs(gone_on(bench, 15)).max() < 1e-6
    assert handle.status is GoalStatus.CANCELED


def test_a_relief_continues_after_a_stall() -> None:
    bench = Bench().up()
    handle = bench.send(to(1.8, 0.9, after_s=1.2, path={"shoulder": 0.1}))
    bench.cycle(6)
    bench.hardware.stuck = {"shoulder"}
    before = -np.inf
    while bench.path()[-1, 0] >= before:
        before = bench.path()[-1, 0]
        bench.cycle()
    stalled(bench, 4)
    bench.cycles_until(lambda: handle.done)
    assert handle.status is GoalStatus.ABORTED
    assert bench.path()[-1, 0] == pytest.approx(bench.hardware.read().position[0], abs=1e-3)


def test_a_path_that_ended_is_resumed_from_the_last_command() -> None:
    """The reference at the end of a path is computed only once. A restart must replace it with a reference at rest."""
    start, end = (Kinematics.at_rest(np.full(2, position)) for position in (0.0, 0.1))
    sampler = TrajectorySampler([ARM_LIMITS] * 2)
    sampler.follow(motion_to(start, end, sampler.limits, 0.2), start)
    for _ in range(20):
        sampler.advance(PERIOD_S)
    assert sampler.ended
    sent = sampler.reference().position - 0.01
    restart(sampler, sent)
    assert sampler.reference().position == pytest.approx(sent)
