"""Test that a cancel brakes along a path of any shape, as a plan around an obstacle requires."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from controller.action_goals import GoalStatus
from controller.motion import Kinematics, MotionError, Path, motion_to
from controller.trajectory.goal import GoalHandle, GoalPoint, TrajectoryGoal
from controller.trajectory.paths import BEGINNING_S
from controller.trajectory.stop_path import stop_along, stop_path
from hal.types import FloatArray, JointLimits
from tests.controller.bench import ARM, ARM_LIMITS, PERIOD_S, Bench, arm_parameters
from tests.controller.moveit_plans import Curve, curved, off_line, off_path, plan, straight

LIMITS = (ARM_LIMITS, ARM_LIMITS)
FOUR = [JointLimits(-3.0, 3.0, 4.0, 12.0, 120.0)] * 4
PATHS = {
    "straight": straight((0.0, 0.0), (1.8, -0.9)),
    "curved": curved((0.0, 0.0), (1.5, 0.2), (0.0, 1.2)),
    "there and back": curved((0.0, 0.0), (0.3, 0.0), (1.4, -1.4)),
}
MOMENTS = [0.05 + 0.1 * n for n in range(10)]
"""Times of the cancels, as shares of a plan's duration."""


def sent(bench: Bench, points: Sequence[GoalPoint]) -> GoalHandle:
    return bench.send(TrajectoryGoal(ARM, tuple(points)))


def driven(points: Sequence[GoalPoint], method: str) -> FloatArray:
    """Return the commands (k, 2) of a plan that is not canceled."""
    bench = Bench(arm_parameters(interpolation_method=method)).up()
    handle = sent(bench, points)
    bench.cycles_until(lambda: handle.done)
    assert handle.status is GoalStatus.SUCCEEDED
    assert bench.path()[-1][:2] == pytest.approx(points[-1].positions, abs=1e-6)
    return bench.path()[:, :2]


@pytest.mark.parametrize("method", ["ruckig", "splines"])
@pytest.mark.parametrize("scale", [1.0, 0.5])
@pytest.mark.parametrize("curve", PATHS.values(), ids=PATHS)
def test_a_plan_at_the_limits_is_executed_and_a_cancel_stays_on_its_path(
    curve: Curve, scale: float, method: str
) -> None:
    points = plan(curve, LIMITS, scale)
    whole = driven(points, method)
    # Plans have no jerk limits, so the jerk-limited path cuts the sharpest bends of a plan.
    assert off_path(whole, points) < (0.02 if scale == 1.0 else 0.005)
    for moment in MOMENTS:
        bench = Bench(arm_parameters(interpolation_method=method)).up()
        handle = sent(bench, points)
        bench.cycle(max(round(moment * points[-1].time_from_start_s / PERIOD_S), 1))
        bench.arm.cancel(handle)
        cycles = bench.cycles_until(lambda handle=handle: handle.done)
        assert handle.status in (GoalStatus.CANCELED, GoalStatus.SUCCEEDED)
        assert cycles * PERIOD_S < 1.5
        assert off_line(bench.path()[:, :2], whole) < 0.01
        at_rest = bench.path()[-1]
        bench.cycle(10)
        assert np.abs(bench.path()[-10:] - at_rest).max() < 1e-3, "told while the arm still moved"


@pytest.mark.parametrize("method", ["ruckig", "splines"])
@pytest.mark.parametrize(
    "curve", [straight((0.015, -0.015), (1.8, -0.9)), curved((0.015, 0.0), (0.3, 0.0), (1.4, -1.4))]
)
def test_a_plan_from_the_measured_position_of_a_sagging_arm_takes_no_longer(curve: Curve, method: str) -> None:
    bent = plan(curve, LIMITS)
    beside = [0.0, 0.0] - np.array(bent[0].positions)
    fitting = [replace(bent[0], positions=(0.0, 0.0)), *bent[1:]]
    path, without = driven(bent, method), driven(plan(lambda along: curve(along) + beside[:, None], LIMITS), method)
    assert len(path) <= len(without) + 2
    assert off_path(path[round(BEGINNING_S / PERIOD_S) + 4 :], bent) < 0.02
    assert np.abs(np.diff(path, axis=0)).max() <= 1.02 * np.abs(np.diff(without, axis=0)).max()
    assert len(driven(fitting, method)) >= len(path), "the first point alone is no better"


def test_a_new_plan_from_the_end_of_a_canceled_plan_is_accepted() -> None:
    bench = Bench().up()
    for moment in MOMENTS * 2:
        points = plan(curved((0.0, 0.0), (1.0, 0.5), (0.3, 0.4)), LIMITS)
        handle = sent(bench, points)
        bench.cycle(max(round(moment * points[-1].time_from_start_s / PERIOD_S), 1))
        bench.arm.cancel(handle)
        bench.cycles_until(lambda handle=handle: handle.done)
        here = bench.loop.hardware.read().position[:2]
        home = plan(straight(tuple(here), (0.0, 0.0)), LIMITS)
        handle = sent(bench, home)
        bench.cycles_until(lambda handle=handle: handle.done)
        assert handle.status is GoalStatus.SUCCEEDED


def test_a_joint_that_rests_beyond_its_limit_can_still_move() -> None:
    bench = Bench().up()
    handle = sent(bench, plan(straight((0.0, 0.0), (-2.0, 0.0)), LIMITS))
    bench.cycles_until(lambda: handle.done)
    bench.hardware._position[0] = -2.0008
    bench.cycle()
    points = plan(straight((-2.0008, 0.0), (0.0, 0.0)), LIMITS)
    handle = sent(bench, points)
    bench.cycles_until(lambda: handle.done)
    assert handle.status is GoalStatus.SUCCEEDED
    assert bench.path()[:, 0].min() >= -2.0


@pytest.mark.parametrize("rate", [0.0, 1e-9, 0.5, 1.0])
@pytest.mark.parametrize("share", [0.0, 1e-6, 0.3, 0.999999, 1.0])
@pytest.mark.parametrize("acceleration", [12.0, np.inf])
def test_a_stop_on_a_path_never_raises(rate: float, share: float, acceleration: float) -> None:
    limits = [JointLimits(-2.0, 2.0, 4.0, acceleration, 120.0)] * 2
    path = motion_to(Kinematics.at_rest(np.zeros(2)), Kinematics.at_rest(np.array((1.0, 0.5))), LIMITS, 1.0)
    stop = stop_along(path, share * path.duration_s, rate, limits)
    if stop is not None and stop is not path:
        assert stop.sample(0.0).position == pytest.approx(path.sample(share * path.duration_s).position, abs=1e-6)
        assert stop.sample(stop.duration_s).velocity == pytest.approx(np.zeros(2), abs=1e-6)


def moving_paths(count: int) -> list[Path]:
    """Return paths of four joints, some of which are moving at the start and may have to reverse."""
    random = np.random.default_rng(1)
    paths: list[Path] = []
    while len(paths) < count:
        moving = random.uniform(-3.0, 3.0, 4) * random.integers(0, 2, 4)
        start = Kinematics(random.uniform(-1.0, 1.0, 4), moving, np.zeros(4))
        end = Kinematics.at_rest(random.uniform(-2.0, 2.0, 4))
        try:
            paths.append(motion_to(start, end, FOUR, float(random.choice([0.0, 2.5]))))
        except MotionError:
            continue
    return paths


def test_a_stop_on_a_path_takes_little_longer_than_a_stop_off_the_path() -> None:
    """In a former version, other joints continued to move for seconds while one joint braked at its limit."""
    for path in moving_paths(60):
        for share in (0.05, 0.15, 0.3, 0.5, 0.7):
            elapsed_s = share * path.duration_s
            stop = stop_along(path, elapsed_s, 1.0, FOUR)
            beside = stop_path(path.sample(elapsed_s), FOUR, FOUR)
            if stop is not None:
                took_s = path.duration_s - elapsed_s if stop is path else stop.duration_s
                assert took_s < beside.duration_s + 0.4
