"""Motion between points with splines: the controllers file is that of ros2_control, without a robot file, as seen from
another process.

The tests compare values within one state: the reference position, the velocity, and the command one period later. The
result therefore does not depend on delays of the machine.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from tests.ros.stack_process import JOINTS
from tests.ros.trajectory_client import REACHED, SUCCEEDED, ZERO, TrajectoryClient, goal_of, point, trajectory
from tests.ros.trajectory_stacks import (
    FASTEST_RAD_S,
    LARGEST_STEP_RAD,
    PERIOD_S,
    case,
    largest_step_rad,
    plain_client,
    rises,
)

T, P = trajectory, point
V, A = (0.8,) * 6, (1.0,) * 6


@pytest.fixture(scope="module")
def plain(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[TrajectoryClient]:
    said = ("allow_partial_joints_goal: true", "allow_integration_in_goal_trajectories: true")
    with plain_client(tmp_path_factory.mktemp("plain"), *said) as client:
        yield client


@pytest.fixture
def at_zero(plain: TrajectoryClient) -> TrajectoryClient:
    if any(abs(position) > 1e-9 for position in plain.states[-1].output.positions):
        plain.executed(goal_of(T(P(0.0, 0.3))))
    return plain


def curve(start: Sequence[float], end: Sequence[float], span_s: float) -> Polynomial:
    """Return the polynomial of lowest degree with these positions, velocities and accelerations at its ends."""
    terms = [Polynomial.basis(power) for power in range(2 * len(start))]
    order = range(len(start))
    rows = [[(t.deriv(d) if d else t)(at_s) for t in terms] for at_s in (0.0, span_s) for d in order]
    return Polynomial(np.linalg.solve(np.array(rows), [*start, *end]))


def on_curve(wanted: Polynomial, span_s: float, states: Sequence[Any]) -> int:
    """Return the number of states on a rising curve. Fail if a state is not exactly on the curve."""
    low, high = wanted(0.05 * span_s), wanted(0.95 * span_s)
    inside = [state for state in states if low < state.reference.positions[0] < high]
    for state in inside:
        roots = (wanted - state.reference.positions[0]).roots()
        (t_s,) = [r.real for r in roots if abs(r.imag) < 1e-9 and 0.0 <= r.real <= span_s]
        assert list(state.reference.positions) == pytest.approx([wanted(t_s)] * 6, abs=1e-9)
        assert list(state.reference.velocities) == pytest.approx([wanted.deriv()(t_s)] * 6, abs=1e-6)
        assert list(state.reference.accelerations) == pytest.approx([wanted.deriv(2)(t_s)] * 6, abs=1e-4)
        if t_s + PERIOD_S < span_s:
            ahead = [wanted(t_s + PERIOD_S)] * 6
            if (
                wanted.deriv()(t_s) > 0.999 * FASTEST_RAD_S
            ):  # At full speed, the arm cannot catch up after a late cycle.
                assert list(state.output.positions) <= [one + 1e-6 for one in ahead]
            else:
                assert list(state.output.positions) == pytest.approx(ahead, abs=1e-6)
    return len(inside)


@pytest.mark.row("jtc-19", "jtc-23", "jtc-26", "golden-two-points")
def test_positions_are_joined_by_lines_and_commanded_a_period_ahead(at_zero: TrajectoryClient) -> None:
    states = at_zero.executed(goal_of(T(P(0.4, 0.5), P(1.0, 1.0))))
    assert on_curve(Polynomial((0.0, 0.8)), 0.5, [s for s in states if s.reference.positions[0] < 0.4])
    assert on_curve(Polynomial((0.4, 1.2)), 0.5, [s for s in states if s.reference.positions[0] > 0.4])
    for held in states[-2:]:
        assert list(held.reference.positions) == list(held.output.positions) == pytest.approx([1.0] * 6, abs=1e-9)
        assert list(held.reference.velocities) == list(ZERO)


CURVES = [
    case("velocities", (P(0.3, 0.4, V), P(1.0, 1.0, ZERO)), (0.8,), rows=["jtc-20", "golden-velocities"]),
    case(
        "velocities and accelerations",
        (P(0.3, 0.4, V, A), P(1.0, 1.0, ZERO, ZERO)),
        (0.8, 1.0),
        rows=["jtc-20", "jtc-23", "golden-accelerations"],
    ),
    case("accelerations at one end only", (P(0.3, 0.4, V), P(1.0, 1.0, ZERO, ZERO)), (0.8,), rows=["jtc-20"]),
]


@pytest.mark.parametrize(("points", "derivatives"), CURVES)
def test_degree_depends_on_both_ends_of_a_segment(
    at_zero: TrajectoryClient, points: Sequence[Any], derivatives: tuple[float, ...]
) -> None:
    states = at_zero.executed(goal_of(T(*points)))
    still = (0.0,) * len(derivatives)
    first = curve((0.0, *still), (0.3, *derivatives), 0.4)
    second = curve((0.3, *derivatives), (1.0, *still), 0.6)
    assert on_curve(first, 0.4, [s for s in states if s.reference.positions[0] < 0.3])
    assert on_curve(second, 0.6, [s for s in states if s.reference.positions[0] > 0.3])


@pytest.mark.row("jtc-21", "golden-no-velocity")
def test_accelerations_without_velocities_are_ignored(at_zero: TrajectoryClient) -> None:
    """In contrast, ros2_control holds its position until the end and then jumps."""
    states = at_zero.executed(goal_of(T(P(0.8, 0.8, (), A))))
    assert on_curve(Polynomial((0.0, 1.0)), 0.8, states)


@pytest.mark.row("jtc-12", "trouble-tiny-velocity", "golden-last-velocity")
def test_final_velocity_counts_as_zero_up_to_the_threshold(at_zero: TrajectoryClient) -> None:
    states = at_zero.executed(goal_of(T(P(0.1, 0.2, (1.18e-7, -1.18e-7, *ZERO[:4])))))
    assert list(states[-1].output.positions) == pytest.approx([0.1] * 6, abs=1e-9)
    for velocity, said in ((1.2e-7, "0.000000120000000"), (-1.2e-7, "-0.000000120000000"), (0.2, "0.200000000000000")):
        reason = at_zero.refusal(goal_of(T(P(0.1, 1.0, (velocity, *ZERO[:5])))))
        assert reason.endswith(f"Velocity of last trajectory point of joint joint1 is not zero: {said}")


NO_TIME = [case("0", 0.0, rows=["jtc-17"]), case("10 ms", 0.01, rows=[]), case("negative", -1.0, rows=["jtc-11"])]


@pytest.mark.row("golden-no-time", "golden-limits")
@pytest.mark.parametrize("after_s", NO_TIME)
def test_single_point_without_time_is_reached_within_the_limits(at_zero: TrajectoryClient, after_s: float) -> None:
    """In contrast, ros2_control jumps to the point."""
    before = at_zero.now()
    status, code, text = at_zero.outcome(at_zero.send(goal_of(T(P(0.5, after_s)))))
    assert (status, code) == (SUCCEEDED, 0)
    assert text == f"{REACHED} The limits stretched the motion from {max(after_s, 0.0):.2f} s to 0.12 s."
    at_zero.cycles(2)
    states = at_zero.states[before:]
    assert on_curve(Polynomial((0.0, FASTEST_RAD_S)), 0.125, states)
    assert largest_step_rad(states) <= LARGEST_STEP_RAD
    assert list(states[-1].output.positions) == pytest.approx([0.5] * 6, abs=1e-9)


@pytest.mark.row("jtc-18", "golden-first-at-zero")
def test_first_point_at_time_0_causes_no_jump(at_zero: TrajectoryClient) -> None:
    """In contrast to ros2_control, a first point that is away from the arm is skipped. Planners begin at the position
    of the arm."""
    states = at_zero.executed(goal_of(T(P(0.0, 0.0), P(0.2, 0.3), P(0.5, 0.6))))
    assert on_curve(Polynomial((0.0, 2.0 / 3.0)), 0.3, [s for s in states if s.reference.positions[0] < 0.2])
    states = at_zero.executed(goal_of(T(P(-0.5, 0.0), P(1.0, 0.5))))
    assert on_curve(Polynomial((0.5, 1.0)), 0.5, states)
    assert min(state.output.positions[0] for state in states) == pytest.approx(0.5, abs=1e-9)


@pytest.mark.row("jtc-11", "golden-negative-first")
def test_first_point_before_time_0_is_skipped(at_zero: TrajectoryClient) -> None:
    states = at_zero.executed(goal_of(T(P(-0.5, -0.5), P(0.4, 0.4))))
    assert on_curve(Polynomial((0.0, 1.0)), 0.4, states)
    assert min(state.output.positions[0] for state in states) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.row("jtc-3", "golden-partial")
def test_partial_goals_are_executed_and_other_joints_hold(plain: TrajectoryClient) -> None:
    held = list(plain.cycles(1)[-1].output.positions)
    states = plain.executed(goal_of(T(P((0.7,), 0.4), names=["joint3"])))
    others = [i for i in range(6) if i != 2]
    for state in states:
        assert [state.output.positions[i] for i in others] == pytest.approx([held[i] for i in others], abs=1e-9)
        assert [state.reference.velocities[i] for i in others] == [0.0] * 5
        assert [state.reference.accelerations[i] for i in others] == [0.0] * 5
    assert any(state.reference.velocities[2] for state in states)
    assert states[-1].output.positions[2] == pytest.approx(0.7, abs=1e-9)
    assert plain.refusal(goal_of(T(P((), 1.0), names=()))).endswith("Empty joint names on incoming trajectory.")


@pytest.mark.row("jtc-9")
def test_velocities_alone_are_integrated_if_allowed(plain: TrajectoryClient) -> None:
    begin = plain.cycles(1)[-1].output.positions[0]
    states = plain.executed(goal_of(T(P((), 0.3, (0.2,) * 6), P((), 0.6, ZERO))))
    assert states[-1].output.positions[0] == pytest.approx(begin + 0.06, abs=1e-6)


@pytest.mark.row("golden-permuted", "jtc-5")
def test_permuted_names_are_mapped_everywhere(at_zero: TrajectoryClient) -> None:
    states = at_zero.executed(goal_of(T(P((0.6, 0.5, 0.4, 0.3, 0.2, 0.1), 0.6), names=JOINTS[::-1])))
    moving = [state for state in states if state.reference.velocities[0]]
    assert moving
    for state in moving:
        assert list(state.joint_names) == list(JOINTS)
        assert list(state.reference.velocities) == pytest.approx([1 / 6, 2 / 6, 3 / 6, 4 / 6, 5 / 6, 1.0])
    assert list(states[-1].output.positions) == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5, 0.6], abs=1e-9)


@pytest.mark.row("jtc-24")
def test_continuous_joint_takes_the_shorter_way(plain: TrajectoryClient) -> None:
    plain.executed(goal_of(T(P((*ZERO[:5], 2.0), 0.6))))
    states = plain.executed(goal_of(T(P((*ZERO[:5], -2.3), 0.6))))
    path = [state.output.positions[5] for state in states]
    assert rises(path)
    assert path[-1] == pytest.approx(math.tau - 2.3, abs=1e-6)


DEFAULTS: dict[str, Any] = {
    **{f"constraints.{joint}.{kind}": 0.0 for joint in JOINTS for kind in ("trajectory", "goal")},
    "constraints.goal_time": 0.0,
    "constraints.stopped_velocity_tolerance": 0.01,
}


@pytest.mark.row("jtc-29")
def test_file_without_tolerances_has_defaults(plain: TrajectoryClient) -> None:
    assert dict(zip(DEFAULTS, plain.get(*DEFAULTS), strict=True)) == DEFAULTS
