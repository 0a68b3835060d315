"""Behavior that MoveIt needs for the execution of a plan, with virtual servos and seen from another process."""

from collections.abc import Iterator
from typing import Any

import pytest

from tests.ros.trajectory_client import (
    CANCELED,
    REACHED,
    SUCCEEDED,
    ZERO,
    TrajectoryClient,
    goal_of,
    measured,
    point,
    stamp_s,
    trajectory,
)
from tests.ros.trajectory_stacks import PERIOD_S, case, client_of, largest_step_rad, rises

DEVIATION_RAD = 0.01
"""Value of MoveIt's allowed_start_tolerance, in rad."""


@pytest.fixture(scope="module")
def servos(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[TrajectoryClient]:
    with client_of(tmp_path_factory.mktemp("servos")) as client:
        yield client


def planned(start: list[float], way_rad: float, duration_s: float, count: int) -> Any:
    """Create a plan like that of a planner: it begins at time 0, with velocities and accelerations at every point.

    Only the wrist turns. The arm starts beside the stand, and a motion of any other joint could hit it.
    """
    points = []
    for index in range(count):
        u = index / (count - 1)
        there = way_rad * u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
        speed = way_rad * 30.0 * u**2 * (1.0 - u) ** 2 / duration_s
        change = way_rad * 60.0 * u * (1.0 - 3.0 * u + 2.0 * u**2) / duration_s**2
        positions = [*start[:5], start[5] + there]
        points.append(point(positions, u * duration_s, [*ZERO[:5], speed], [*ZERO[:5], change]))
    return trajectory(*points)


PLANS = [
    case("few points", 0.6, 0.8, 8, rows=[]),
    case("many points", -0.6, 1.0, 100, rows=[]),
]


@pytest.mark.row("moveit-duration", "moveit-status")
@pytest.mark.parametrize(("way_rad", "duration_s", "count"), PLANS)
def test_result_arrives_within_the_timeout_of_moveit(
    servos: TrajectoryClient, way_rad: float, duration_s: float, count: int
) -> None:
    """The time is measured with the stamps of the feedback. The last feedback precedes the result by one cycle."""
    start = measured(servos)
    sent = servos.send(goal_of(planned(start, way_rad, duration_s, count)))
    status, code, text = servos.outcome(sent)
    assert (status, code) == (SUCCEEDED, 0) and text.startswith(REACHED)
    servos.cycles(2)
    took_s = stamp_s(sent.feedback[-1]) - stamp_s(sent.feedback[0]) + PERIOD_S
    assert took_s <= 1.1 * duration_s + 0.5
    there = [*start[:5], start[5] + way_rad]
    assert list(servos.states[-1].output.positions) == pytest.approx(there, abs=1e-6)
    servos.until(lambda: list(servos.states[-1].feedback.positions) == pytest.approx(there, abs=0.03))


@pytest.mark.row("moveit-start", "jtc-18")
@pytest.mark.parametrize("deviation_rad", [DEVIATION_RAD, -DEVIATION_RAD])
def test_slightly_deviating_start_is_accepted_without_a_step(servos: TrajectoryClient, deviation_rad: float) -> None:
    servos.cycles(10)  # comes to rest
    start = [position + deviation_rad for position in servos.states[-1].output.positions]
    before = servos.now()
    sent = servos.send(goal_of(trajectory(point(start, 0.0, ZERO, ZERO), point(start, 0.6, ZERO, ZERO))))
    assert servos.outcome(sent) == (SUCCEEDED, 0, REACHED)
    servos.cycles(2)
    assert largest_step_rad(servos.states[before:], "output") < DEVIATION_RAD / 4.0
    assert list(servos.states[-1].output.positions) == pytest.approx(start, abs=1e-6)


@pytest.mark.row("moveit-cancel", "golden-cancel")
@pytest.mark.slow
def test_cancel_is_accepted_immediately_and_its_result_follows_at_rest(servos: TrajectoryClient) -> None:
    before = servos.now()
    sent = servos.send(goal_of(planned(measured(servos), 1.0, 2.0, 8)))
    servos.until(lambda: servos.states[-1].reference.velocities[5] > 0.5)
    asked = len(servos.states)
    assert servos.cancel(sent) == 1
    assert len(servos.states) - asked <= 2
    assert servos.outcome(sent) == (CANCELED, 0, "")
    assert len(servos.states) - asked <= 1.0 / PERIOD_S
    there = measured(servos)
    servos.cycles(3)
    assert measured(servos) == pytest.approx(there, abs=DEVIATION_RAD / 2.0)
    path = [state.reference.positions[5] for state in servos.states[before:]]
    assert rises(path) and path[-1] == path[-3]
