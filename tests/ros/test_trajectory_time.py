"""Start, progress and end of a trajectory with splines, as seen from another process.

A state on a straight line reveals the time of the trajectory: its stamp shows when the line started and when it will
end.
"""

import re
import signal
import time
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

import pytest

from tests.ros.trajectory_client import (
    REACHED,
    SUCCEEDED,
    ZERO,
    Sent,
    TrajectoryClient,
    goal_of,
    point,
    seconds,
    stamp_s,
    trajectory,
)
from tests.ros.trajectory_stacks import LARGEST_STEP_RAD, PERIOD_S, largest_step_rad, plain_client

T, P = trajectory, point
CLOCK_S = 0.02
"""Accuracy with which a stamp gives the time of the measurement and of the next cycle, in seconds. The value is below
half a period."""
LATE_S = 0.5


@pytest.fixture(scope="module")
def plain(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[TrajectoryClient]:
    with plain_client(tmp_path_factory.mktemp("plain")) as client:
        yield client


@pytest.fixture
def at_zero(plain: TrajectoryClient) -> TrajectoryClient:
    if any(abs(position) > 1e-9 for position in plain.states[-1].output.positions):
        plain.executed(goal_of(T(P(0.0, 0.3))))
    return plain


def on_line(states: Sequence[Any], speed_rad_s: float) -> list[Any]:
    """Return the states in which the joint moves at this speed."""
    found = [state for state in states if abs(state.reference.velocities[0] - speed_rad_s) < 1e-3]
    assert found
    return found


def passes_s(states: Sequence[Any], position_rad: float) -> list[float]:
    """Return, for each state of a uniform motion, the time at which the joint would be at this position."""
    refs = [state.reference for state in states]
    return [stamp_s(s) + (position_rad - r.positions[0]) / r.velocities[0] for s, r in zip(states, refs, strict=True)]


def first_after(client: TrajectoryClient, moment_s: float) -> float:
    """Return the stamp of the first cycle after a given time."""
    client.until(lambda: stamp_s(client.states[-1]) > moment_s)
    return next(stamp_s(state) for state in client.states if stamp_s(state) > moment_s)


def finish(client: TrajectoryClient, sent: Sent, before: int) -> list[Any]:
    """Return all states from ``before`` to the success of the goal."""
    assert client.outcome(sent) == (SUCCEEDED, 0, REACHED)
    client.cycles(2)
    return client.states[before:]


@pytest.mark.row("jtc-13", "jtc-16", "golden-one-point")
@pytest.mark.parametrize("ahead_s", [None, 0.4])
def test_motion_starts_in_the_first_cycle_after_the_goal(at_zero: TrajectoryClient, ahead_s: float | None) -> None:
    """A stamp in the future does not delay the start: the motion to the first point lasts until the time of the
    stamp."""
    before, sent_s = at_zero.now(), seconds(at_zero.stamp(0.0))
    sent = at_zero.send(goal_of(T(P(0.6, 0.6), stamp=None if ahead_s is None else at_zero.stamp(ahead_s))))
    accepted_s = seconds(at_zero.stamp(0.0))
    first_s = first_after(at_zero, accepted_s)
    moving = [state for state in finish(at_zero, sent, before) if state.reference.velocities[0] > 0.1]
    for begin_s in passes_s(moving, 0.0):
        assert sent_s - CLOCK_S < begin_s < first_s + CLOCK_S
    commanded = [state for state in at_zero.states[before:] if state.output.positions[0] > 1e-6]
    assert stamp_s(commanded[0]) <= first_s


@pytest.mark.row("jtc-16", "golden-stamp-ahead")
def test_point_times_count_from_a_future_stamp(at_zero: TrajectoryClient) -> None:
    before, stamp = at_zero.now(), at_zero.stamp(0.5)  # Right after a cycle, the next one is almost a period away.
    states = finish(at_zero, at_zero.send(goal_of(T(P(0.3, 0.5), P(0.7, 0.7), stamp=stamp))), before)
    to_first = [s for s in states if 0.01 < s.reference.positions[0] < 0.29]
    assert to_first
    for state, at_s in zip(to_first, passes_s(to_first, 0.3), strict=True):
        assert at_s == pytest.approx(seconds(stamp) + 0.5, abs=CLOCK_S)
        assert 0.3 <= state.reference.velocities[0] < 0.35  # The motion uses all the time until its first point.
    last = on_line(states, 2.0)
    assert passes_s(last, 0.7) == pytest.approx([seconds(stamp) + 0.7] * len(last), abs=CLOCK_S)


@pytest.mark.row("jtc-15", "golden-stamp-past")
def test_past_stamp_joins_the_trajectory_at_its_present_point(at_zero: TrajectoryClient) -> None:
    """Past points are skipped. In contrast to ros2_control, the arm moves onto the trajectory without a jump."""
    before, stamp = at_zero.now(), at_zero.stamp(-1.0)
    states = finish(at_zero, at_zero.send(goal_of(T(P(0.9, 0.5), P(0.3, 1.5), P(0.5, 2.0), stamp=stamp))), before)
    joining = [s for s in states if 0.01 < s.reference.positions[0] < 0.29]
    assert passes_s(joining, 0.3) == pytest.approx([seconds(stamp) + 1.5] * len(joining), abs=CLOCK_S)
    last = on_line(states, 0.4)
    assert passes_s(last, 0.5) == pytest.approx([seconds(stamp) + 2.0] * len(last), abs=CLOCK_S)
    assert max(state.output.positions[0] for state in states) == pytest.approx(0.5, abs=1e-9)
    assert largest_step_rad(states) <= LARGEST_STEP_RAD


@pytest.mark.row("jtc-43", "golden-scaling")
def test_half_speed_takes_twice_as_long_and_negative_speeds_are_ignored(at_zero: TrajectoryClient) -> None:
    at_zero.scale(0.5)
    at_zero.until(lambda: at_zero.states[-1].speed_scaling_factor == 0.5)
    at_zero.scale(-1.0)
    at_zero.until(
        lambda: (
            "the speed scaling factor must be 0 (pause) to 1 (the speed of the goal), not -1.0" in at_zero.stack.words
        )
    )
    before = at_zero.now()
    states = finish(at_zero, at_zero.send(goal_of(T(P(0.5, 0.5)))), before)
    at_zero.scale(1.0)
    moving = [state for state in states if 0.01 < state.reference.positions[0] < 0.49]
    ends_s, begins_s = passes_s(moving, 0.5), passes_s(moving, 0.0)
    assert [end - begin for end, begin in zip(ends_s, begins_s, strict=True)] == pytest.approx([1.0] * len(moving))
    assert begins_s == pytest.approx([begins_s[0]] * len(moving), abs=2.0 * CLOCK_S)
    assert {state.speed_scaling_factor for state in moving} == {0.5}
    at_zero.until(lambda: at_zero.states[-1].speed_scaling_factor == 1.0)


@pytest.mark.row("jtc-43", "golden-scaling")
def test_speed_0_freezes_a_motion_and_1_resumes_it(at_zero: TrajectoryClient) -> None:
    before = at_zero.now()
    sent = at_zero.send(goal_of(T(P(0.8, 0.8))))
    at_zero.until(lambda: at_zero.states[-1].reference.positions[0] > 0.2)
    at_zero.scale(0.0)
    at_zero.until(lambda: at_zero.states[-1].speed_scaling_factor == 0.0)
    at_zero.cycles(2)
    frozen = at_zero.cycles(6)
    assert len({tuple(state.output.positions) for state in frozen}) == 1
    assert 0.2 < frozen[0].output.positions[0] < 0.8
    assert list(frozen[0].reference.velocities) == list(ZERO)
    assert not sent.result.done()
    at_zero.scale(1.0)
    path = [state.output.positions[0] for state in finish(at_zero, sent, before)]
    assert min(after - before for before, after in pairwise(path)) > -1e-3  # A cycle may come slightly early.
    assert path[-1] == pytest.approx(0.8, abs=1e-9)


@pytest.mark.row("jtc-42", "cm-overruns")
def test_blocked_loop_skips_cycles_and_the_trajectory_continues(plain: TrajectoryClient) -> None:
    """In contrast to ros2_control, time advances by two periods at most, so that the arm does not jump after a
    stall."""
    there, speed = 1.6, 2.2
    plain.executed(goal_of(T(P((-there, *ZERO[1:]), 0.7))))
    before = plain.now()
    sent = plain.send(goal_of(T(P((there, *ZERO[1:]), 2.0 * there / speed))))
    plain.until(lambda: plain.states[-1].reference.positions[0] > 0.3 - there)
    plain.stack.process.send_signal(signal.SIGSTOP)
    try:
        time.sleep(LATE_S)  # A stopped process publishes nothing.
    finally:
        plain.stack.process.send_signal(signal.SIGCONT)
    states = finish(plain, sent, before)
    passed = []
    for one, other in pairwise(on_line(states, speed)):
        way_rad = other.reference.positions[0] - one.reference.positions[0]
        passed.append((stamp_s(other) - stamp_s(one), way_rad / speed))
    late_s, went_on_s = max(passed)
    assert late_s > LATE_S
    assert 2.0 * PERIOD_S - CLOCK_S < went_on_s < 3.0 * PERIOD_S + CLOCK_S  # three periods if a state was skipped
    for between_s, on_s in passed:
        if between_s < 2.0 * PERIOD_S:
            assert on_s == pytest.approx(between_s, abs=CLOCK_S)
    for one, other in pairwise(states):
        between_s = stamp_s(other) - stamp_s(one)
        # Otherwise, the two states are not consecutive, because a state was skipped
        if between_s < 1.5 * PERIOD_S or between_s > LATE_S:
            assert abs(other.feedback.positions[0] - one.feedback.positions[0]) <= LARGEST_STEP_RAD
    assert states[-1].output.positions[0] == pytest.approx(there, abs=1e-9)
    missed = re.findall(r"missed (\d+) cycles? of", plain.stack.words)
    assert max(map(int, missed)) >= LATE_S / PERIOD_S - 1
