"""Test that the arm follows a stream of short trajectories, each replacing the last, with little lag."""

import math

import numpy as np
import pytest

from controller.trajectory.goal import GoalPoint, TrajectoryGoal
from tests.controller.bench import ARM, ARM_LIMITS, PERIOD_S, Bench, arm_parameters

RAD_S, AMPLITUDE_RAD = 2.0, 0.5
SENT_S = 0.02
"""Time after a cycle at which a message is sent, in seconds."""
LAG_S = 0.1


def wanted(time_s: float) -> float:
    """Return the position of a smooth motion from rest."""
    return AMPLITUDE_RAD * (1.0 - math.cos(RAD_S * time_s)) / 2.0 if time_s > 0.0 else 0.0


def streamed(bench: Bench, horizon_s: float, step_s: float, every: int, stamped: bool) -> np.ndarray:
    """Run cycles and send a window of points every few cycles. Return times and reference positions (k, 2)."""
    bench.cycle()
    began_s, rows = bench.clock.now(), []
    for cycle in range(60):
        now_s = bench.clock.now()
        if cycle % every == 0:
            times_s = np.arange(step_s, horizon_s + 1e-9, step_s).tolist()
            points = [GoalPoint((wanted(now_s + SENT_S - began_s + t), 0.0), t) for t in times_s]
            goal = TrajectoryGoal(
                ARM,
                tuple(points),
                delay_s=-0.0005 if stamped else 0.0,
                from_topic=True,
                next_cycle_s=PERIOD_S - SENT_S,
                begins_s=now_s + PERIOD_S,
            )
            bench.send(goal)
        bench.cycle()
        assert bench.arm.tracking is not None
        rows.append((bench.arm.tracking.stamp_s - began_s, bench.arm.tracking.reference.position[0]))
    return np.array(rows)


def lag_s(rows: np.ndarray) -> float:
    """Return the delay that fits the motion best after the stream has settled."""
    later = rows[15:]
    delays = np.arange(-0.2, 0.5, 0.005)
    errors = [np.square(later[:, 1] - [wanted(t - delay) for t in later[:, 0]]).sum() for delay in delays]
    return float(delays[int(np.argmin(errors))])


@pytest.mark.parametrize(
    ("method", "horizon_s", "step_s", "every", "stamped"),
    [
        ("ruckig", 0.1, 0.1, 1, True),
        ("ruckig", 0.1, 0.02, 1, True),
        ("ruckig", 0.2, 0.05, 1, True),
        ("ruckig", 0.2, 0.1, 1, True),
        ("ruckig", 0.3, 0.02, 4, True),
        ("ruckig", 0.5, 0.1, 2, True),
        ("ruckig", 0.1, 0.02, 1, False),
        ("ruckig", 0.3, 0.02, 4, False),
        ("splines", 0.3, 0.02, 4, True),
    ],
)
def test_a_stream_of_short_trajectories_is_followed(
    method: str, horizon_s: float, step_s: float, every: int, stamped: bool
) -> None:
    bench = Bench(arm_parameters(interpolation_method=method)).up()
    rows = streamed(bench, horizon_s, step_s, every, stamped)
    assert abs(lag_s(rows)) < LAG_S
    assert np.abs([position - wanted(t) for t, position in rows[15:]]).max() < 0.08
    bench.cycle(20)
    assert bench.path()[-1] == pytest.approx(bench.path()[-2]), "the last window ends at rest"
    velocity = np.diff(bench.path()[:, 0]) / PERIOD_S
    assert np.abs(velocity).max() <= ARM_LIMITS.velocity
    assert method == "splines" or np.abs(np.diff(velocity)).max() <= ARM_LIMITS.acceleration * PERIOD_S * 1.001


def test_a_goal_during_a_motion_passes_a_near_first_point() -> None:
    bench = Bench().up()
    bench.send(TrajectoryGoal(ARM, (GoalPoint((1.0, 0.0), 2.0),)))
    bench.cycle(20)
    here = bench.path()[-1][0]
    bench.send(TrajectoryGoal(ARM, (GoalPoint((here + 0.1, 0.05), 0.2), GoalPoint((0.0, 0.0), 3.0))))
    bench.cycle(6)
    assert np.abs(bench.path()[-6:, :2] - (here + 0.1, 0.05)).max(axis=1).min() < 0.03
