"""Run plans like those of MoveIt over the real action and on virtual servos: some are executed, some canceled and some
blocked."""

import math
import re
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pytest

from controller.trajectory.goal import GoalPoint
from hal.types import FloatArray, JointLimits
from tests.controller.moveit_plans import Curve, curved, off_line, plan, straight
from tests.ros.trajectory_client import (
    ABORTED,
    CANCELED,
    REACHED,
    SUCCEEDED,
    Sent,
    TrajectoryClient,
    goal_of,
    measured,
    point,
    trajectory,
)
from tests.ros.trajectory_stacks import PERIOD_S, client_of

pytestmark = pytest.mark.slow

LIMITS = [JointLimits(-3.6, 3.6, 3.6, 9.6, 120.0)] * 6
"""Velocity and acceleration limits of config/moveit/joint_limits.yaml."""
READY = (0.0, -0.3643, -0.6419, -0.8154, -0.9541, -1.6828)
AROUND_THE_STAND = (0.0, -0.41, -0.76, -0.70, -1.10, 1.55)
"""Pose below the top of the stand, with one finger on each side of it."""
LEFT, RIGHT = (0.4, -0.2, -0.8, -0.6, -1.1, 1.55), (-0.4, -0.2, -0.8, -0.6, -1.1, 1.55)
BOWS = {
    "straight": (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    "with a turn of the wrist": (0.0, 0.0, 0.0, 0.0, 0.0, -1.2),
    "over an obstacle": (0.0, 0.25, 0.0, 0.0, 0.1, 0.0),
}
FOLLOWING_RAD = 0.04
"""Maximum following error of full-speed plans due to sag and lag, in rad."""
START_RAD = 0.01
"""Value of MoveIt's allowed_start_tolerance, in rad."""
BACKLASH_RAD = math.radians(1.0)


@pytest.fixture(scope="module")
def servos(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[TrajectoryClient]:
    with client_of(tmp_path_factory.mktemp("moveit")) as client:
        yield client


def message(points: Sequence[GoalPoint]) -> Any:
    return trajectory(
        *(point(one.positions, one.time_from_start_s, one.velocities, one.accelerations) for one in points)
    )


def driven(client: TrajectoryClient, curve: Curve, scale: float = 1.0) -> FloatArray:
    """Run a plan, check that it succeeds, and return the reference positions until the arm is at rest, shape (k, 6)."""
    first = len(client.states)
    status, code, text = client.outcome(client.send(goal_of(message(plan(curve, LIMITS, scale)))))
    assert (status, code) == (SUCCEEDED, 0) and text.startswith(REACHED), text
    client.cycles(4)  # The arm has arrived within the tolerance and continues to approach the goal.
    return references(client, first)


def references(client: TrajectoryClient, first: int) -> FloatArray:
    """Return the reference positions. The commands to the servos lead the reference by the lag of each servo."""
    return np.array([state.reference.positions for state in client.states[first:]])


def ways(client: TrajectoryClient, first: int) -> FloatArray:
    """Return the measured positions."""
    return np.array([state.feedback.positions for state in client.states[first:]])


def test_blocked_joint_is_named_aborts_and_is_relieved_within_two_seconds(servos: TrajectoryClient) -> None:
    driven(servos, straight(tuple(measured(servos)), AROUND_THE_STAND), 0.5)
    start = tuple(measured(servos))
    sent = servos.send(goal_of(message(plan(straight(start, (0.6, *start[1:])), LIMITS))))
    status, code, text = servos.outcome(sent)
    assert (status, code) == (ABORTED, -4)
    assert re.fullmatch(r"Aborted due to path tolerance violation: joint1 is off by 0\.\d+, allowed is 0\.3000", text)
    held = [any(abs(off) > 0.05 for off in message.error.positions) for message in sent.feedback]
    assert sum(held) * PERIOD_S < 2.0
    driven(servos, straight(tuple(measured(servos)), start), 0.5)  # back from the stand on the same path


@pytest.mark.parametrize(("turn", "bow"), enumerate(BOWS.values()), ids=BOWS)
def test_plans_arrive_or_stop_on_their_path_when_canceled(
    servos: TrajectoryClient, turn: int, bow: tuple[float, ...]
) -> None:
    for pose in (READY, RIGHT):
        driven(servos, straight(tuple(measured(servos)), pose), 0.5)
    whole = driven(servos, curved(tuple(measured(servos)), LEFT, bow))
    driven(servos, straight(tuple(measured(servos)), RIGHT))
    for moment in (0.05 + 0.1 * n for n in range(turn, 10, len(BOWS))):
        points = plan(curved(tuple(measured(servos)), LEFT, bow), LIMITS)
        first = len(servos.states)
        sent = servos.send(goal_of(message(points)))
        canceled_on(servos, sent, moment * points[-1].time_from_start_s)
        here = tuple(measured(servos))
        assert off_line(references(servos, first), whole) < 0.01
        assert off_line(ways(servos, first), whole) < FOLLOWING_RAD
        servos.cycles(4)
        # An arm that arrived before the cancel still approaches the goal. The gears have a backlash of one degree.
        assert tuple(measured(servos)) == pytest.approx(here, abs=BACKLASH_RAD), (
            "the goal ended while the arm still moved"
        )
        driven(servos, straight(tuple(measured(servos)), RIGHT))


def canceled_on(client: TrajectoryClient, sent: Sent, after_s: float) -> bool:
    """Cancel a goal after a time, and return whether it was still running."""
    client.until(lambda: len(sent.feedback) >= max(round(after_s / PERIOD_S), 1))
    client.cancel(sent)
    outcome = client.outcome(sent)[:2]
    assert outcome in ((CANCELED, 0), (SUCCEEDED, 0))
    return outcome == (CANCELED, 0)
