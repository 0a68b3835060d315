"""Tolerances, timeouts and the position that is held afterward, with joints that do not move.

The states of the mock are frozen. The controllers file sets tolerances only for joint1.
"""

import math
import re
from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any

import pytest

from tests.ros.trajectory_client import (
    ABORTED,
    CANCELED,
    NONE,
    REACHED,
    SUCCEEDED,
    TrajectoryClient,
    goal_of,
    point,
    seconds,
    stamp_s,
    trajectory,
)
from tests.ros.trajectory_stacks import LARGEST_STEP_RAD, PERIOD_S, case, largest_step_rad, plain_client, rises

T, P = trajectory, point
PATH = (ABORTED, -4, "Aborted due to path tolerance violation")


OFF = r"joint\d is off by \d\.\d{4,}, allowed is \d\.\d{4}"


def cut(ended: tuple[int, int, str]) -> tuple[int, int, str]:
    """Return an outcome without the joint and the deviation in its text."""
    status, code, text = ended
    said, _, off = text.partition(": ")
    assert re.fullmatch(OFF, off), text
    return status, code, said


MEASURED = (0.0, 0.0, 0.25, 0.0, 0.0, 0.0)
"""Frozen positions of the joints."""
ERASED: Mapping[str, float] = {"joint1": -1.0}
UNKNOWN = ["jtc-30", "golden-unknown-tolerance"]
SETTINGS = (
    "allow_partial_joints_goal: true",
    "constraints: {goal_time: 0.15, decelerate_on_cancel: false, joint1: {trajectory: 0.05, goal: 0.02}}",
)


@pytest.fixture(scope="module")
def stack(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[TrajectoryClient]:
    folder = tmp_path_factory.mktemp("stuck")
    with plain_client(folder, *SETTINGS, initial_rad={"joint3": 0.25}, disable_commands="true") as client:
        yield client


@pytest.fixture
def stuck(stack: TrajectoryClient) -> Iterator[TrajectoryClient]:
    """Provide a client with an arm that holds the measured positions, and restore the parameters of the file at the
    end."""
    if list(stack.states[-1].output.positions) != pytest.approx(MEASURED):
        stack.executed(goal_of(T(P(MEASURED, 0.2)), path=ERASED, goal=ERASED))
    yield stack
    for name, value in (("constraints.decelerate_on_cancel", False), ("cmd_timeout", 0.0)):
        assert stack.set(name, value) == (True, "")


def joint(number: int, position_rad: float, after_s: float) -> Any:
    """Create a trajectory for one joint. The others hold."""
    return T(P((position_rad,), after_s), names=[f"joint{number}"])


def commanded(client: TrajectoryClient, number: int) -> float:
    """Return the command of the joint two cycles later."""
    return float(client.cycles(2)[-1].output.positions[number - 1])


def exceeded_s(text: str) -> float:
    """Return the time by which goal_time was exceeded, as stated in the result."""
    said, _, off = text.partition(": ")
    assert re.fullmatch(OFF, off), text
    said = re.fullmatch(r"Aborted due to goal_time_tolerance exceeding by (\d+\.\d{6}) seconds", said)
    assert said is not None, text
    return float(said[1])


@pytest.mark.row("jtc-36")
def test_first_activation_holds_the_measured_position(stack: TrajectoryClient) -> None:
    assert list(stack.states[0].output.positions) == pytest.approx(MEASURED, abs=1e-9)
    assert list(stack.states[0].reference.positions) == pytest.approx(MEASURED, abs=1e-9)


@pytest.mark.row("jtc-26", "golden-stuck")
def test_without_tolerances_a_stuck_joint_succeeds(stuck: TrajectoryClient) -> None:
    states = stuck.executed(goal_of(joint(2, 0.5, 0.3)))
    assert list(states[-1].feedback.positions) == pytest.approx(MEASURED)
    assert states[-1].output.positions[1] == pytest.approx(0.5)
    assert states[-1].error.positions[1] == pytest.approx(0.5)


FILE, VALUES = ("path", 0.05), ["jtc-30", "golden-tolerance-values"]
TOLERANCES = [
    case("none in the goal: the file's", NONE, NONE, 0.0, FILE, rows=["jtc-25", "jtc-30"]),
    case("path 0: the file's", {"joint1": 0.0}, NONE, 0.0, FILE, rows=["jtc-30"]),
    case("path above 0 overrides", {"joint1": 0.17}, ERASED, 0.0, ("path", 0.17), rows=["jtc-25", "jtc-30"]),
    case("path above the error", {"joint1": 0.6}, ERASED, 0.0, None, rows=["jtc-30"]),
    case("path -1 erases", ERASED, NONE, 0.0, ("goal", 0.15), rows=VALUES),
    case("goal 0: the file's", ERASED, {"joint1": 0.0}, 0.0, ("goal", 0.15), rows=["jtc-28", "jtc-30"]),
    case("goal above the error", ERASED, {"joint1": 0.6}, 0.0, None, rows=["jtc-26", "jtc-30"]),
    case("both -1", ERASED, ERASED, 0.0, None, rows=VALUES),
    case("goal_time above 0 overrides", ERASED, NONE, 0.35, ("goal", 0.35), rows=["jtc-28", "jtc-30"]),
    case("path -2: the file's", {"joint1": -2.0}, NONE, 0.0, FILE, rows=VALUES),
    case("another joint's -2: all the file's", {**ERASED, "joint2": -2.0}, ERASED, 0.0, FILE, rows=VALUES),
    case("goal -2: all the file's", ERASED, {"joint1": -2.0}, 0.0, FILE, rows=VALUES),
    case("goal_time -2: all the file's", ERASED, ERASED, -2.0, FILE, rows=VALUES),
    case("an unknown joint: all the file's", {**ERASED, "foo": 0.1}, ERASED, 0.0, FILE, rows=UNKNOWN),
]


@pytest.mark.parametrize(("path", "goal", "goal_time_s", "violated"), TOLERANCES)
def test_tolerance_of_goal_or_file_applies(
    stuck: TrajectoryClient,
    path: Mapping[str, float],
    goal: Mapping[str, float],
    goal_time_s: float,
    violated: tuple[str, float] | None,
) -> None:
    before = stuck.now()
    ended = stuck.outcome(stuck.send(goal_of(joint(1, 0.3, 0.3), goal_time_s, path, goal)))
    if violated is None:
        assert ended == (SUCCEEDED, 0, REACHED)
        return
    stuck.cycles(1)
    which, limit = violated
    if which == "path":
        assert cut(ended) == PATH
        furthest_rad = max(state.reference.positions[0] for state in stuck.states[before:])
        assert limit < furthest_rad < limit + 2.0 * PERIOD_S + 0.01  # at 1 rad/s, this is at most two cycles
    else:
        assert ended[:2] == (ABORTED, -5)
        assert limit <= exceeded_s(ended[2]) < limit + 2.0 * PERIOD_S + 0.01
        assert commanded(stuck, 1) == pytest.approx(0.0, abs=1e-6), "the joint is relieved"


@pytest.mark.row("golden-unknown-tolerance", "jtc-30")
@pytest.mark.parametrize("kind", ["path", "goal"])
def test_invalid_tolerance_is_named_in_the_log(stuck: TrajectoryClient, kind: str) -> None:
    assert stuck.outcome(stuck.send(goal_of(joint(2, 0.1, 0.1), **{kind: {"foo": 0.1}}))) == (SUCCEEDED, 0, REACHED)
    said = f"joint 'foo' specified in goal.{kind}_tolerance does not exist. Using default tolerances."
    assert said in stuck.stack.words


@pytest.mark.row("jtc-25", "golden-stuck-path", "golden-path-tolerance")
def test_violated_path_tolerance_aborts_and_holds_the_measured_position(stuck: TrajectoryClient) -> None:
    """Without deceleration, the arm holds the measured position, as in ros2_control."""
    before = stuck.now()
    sent = stuck.send(goal_of(joint(2, 0.8, 1.6), path={"joint2": 0.05}))
    assert cut(stuck.outcome(sent)) == PATH
    stuck.until(lambda: stuck.states[-1].output.positions == pytest.approx(MEASURED, abs=1e-9))
    held = stuck.cycles(4)
    assert all(list(state.output.positions) == pytest.approx(MEASURED, abs=1e-9) for state in held)
    assert 0.05 < max(state.reference.positions[1] for state in stuck.states[before:]) < 0.4


@pytest.mark.row("jtc-25", "jtc-34", "golden-path-tolerance")
def test_decelerating_abort_brakes_and_relieves_a_blocked_joint(stuck: TrajectoryClient) -> None:
    """Deceleration is the default in this project. The goal ends when the joints are at rest and no longer press
    against an obstacle."""
    assert stuck.set("constraints.decelerate_on_cancel", True) == (True, "")
    before = stuck.now()
    assert cut(stuck.outcome(stuck.send(goal_of(joint(2, 1.5, 1.5), path={"joint2": 0.4})))) == PATH
    stuck.cycles(3)
    states = stuck.states[before:]
    path = [state.output.positions[1] for state in states]
    assert 0.4 < max(path) < 0.65
    assert path[-1] == pytest.approx(MEASURED[1], abs=1e-6) and path[-1] == pytest.approx(path[-3], abs=1e-6)
    assert largest_step_rad(states, "output") <= LARGEST_STEP_RAD
    reference = [state.reference.positions[1] for state in states]
    back = reference[reference.index(max(reference)) :]
    assert rises(back[::-1])


@pytest.mark.row("jtc-28", "jtc-34", "golden-stuck-goal-time")
@pytest.mark.parametrize("decelerate", [False, True])
def test_blocked_joint_is_relieved_after_goal_time(stuck: TrajectoryClient, decelerate: bool) -> None:
    """In contrast to ros2_control, the command returns to the measured position slowly and without a step."""
    assert stuck.set("constraints.decelerate_on_cancel", decelerate) == (True, "")
    before = stuck.now()
    ended = stuck.outcome(stuck.send(goal_of(joint(2, 0.5, 0.3), goal_time_s=0.3, goal={"joint2": 0.01})))
    assert ended[:2] == (ABORTED, -5)
    assert 0.3 <= exceeded_s(ended[2]) < 0.3 + 2.0 * PERIOD_S + 0.01
    stuck.cycles(4)
    path = [state.output.positions[1] for state in stuck.states[before:]]
    assert max(path) == pytest.approx(0.5) and path[-1] == pytest.approx(MEASURED[1], abs=1e-6)
    assert max(abs(b - a) for a, b in pairwise(path)) <= LARGEST_STEP_RAD


@pytest.mark.row("jtc-27", "jtc-33", "golden-stuck-for-ever")
def test_goal_without_goal_time_runs_until_canceled_and_holds_the_measured_position(stuck: TrajectoryClient) -> None:
    sent = stuck.send(goal_of(joint(2, 0.5, 0.2), goal_time_s=-1.0, goal={"joint2": 0.01}))
    stuck.cycles(10)
    assert not sent.result.done()
    assert stuck.states[-1].output.positions[1] == pytest.approx(0.5)
    assert stuck.cancel(sent) == 1
    assert stuck.outcome(sent) == (CANCELED, 0, "")
    stuck.until(lambda: stuck.states[-1].output.positions == pytest.approx(MEASURED, abs=1e-9))


@pytest.mark.row("jtc-34", "jtc-40")
@pytest.mark.parametrize("decelerate", [False, True])
def test_cmd_timeout_after_the_last_point_holds_the_measured_position(
    stuck: TrajectoryClient, decelerate: bool
) -> None:
    assert stuck.set("constraints.decelerate_on_cancel", decelerate) == (True, "")
    assert stuck.set("cmd_timeout", 0.25) == (True, "")
    before, sent_s = stuck.now(), seconds(stuck.stamp(0.0))
    sent = stuck.send(goal_of(joint(2, 0.5, 0.3), goal_time_s=-1.0, goal={"joint2": 0.01}))
    assert stuck.outcome(sent) == (ABORTED, -5, "Aborted due to command timeout")
    stuck.until(lambda: stuck.states[-1].output.positions == pytest.approx(MEASURED, abs=1e-9))
    states = stuck.states[before:]
    there = [state for state in states if state.output.positions[1] > 0.4999]
    assert stamp_s(there[-1]) > sent_s + 0.3 + 0.25 - 2.0 * PERIOD_S
    assert {state.reference.velocities[1] for state in there[2:]} == {0.0}  # It was at rest before.


@pytest.mark.row("jtc-36", "jtc-3")
def test_repeated_activation_holds_the_last_command(stuck: TrajectoryClient) -> None:
    stuck.executed(goal_of(joint(2, 0.5, 0.2)))
    assert stuck.switch(on=False)
    assert stuck.switch(on=True)
    held = stuck.cycles(3)
    told = [0.0, 0.5, *MEASURED[2:]]
    for state in held[-2:]:
        assert list(state.output.positions) == pytest.approx(told, abs=1e-9)
        assert list(state.feedback.positions) == pytest.approx(MEASURED, abs=1e-9)
    states = stuck.executed(goal_of(joint(4, 0.2, 0.2)))  # Joints outside the goal also keep their command.
    told[3] = 0.2
    assert list(states[-1].output.positions) == pytest.approx(told, abs=1e-9)
    assert [state.output.positions[1] for state in states] == pytest.approx([0.5] * len(states), abs=1e-9)


@pytest.mark.row("jtc-24")
@pytest.mark.slow
def test_error_of_a_continuous_joint_takes_the_shorter_way(stuck: TrajectoryClient) -> None:
    names = ["joint6"]
    goal = T(P((2.4,), 0.65), P((3.6,), 1.0), names=names)
    tolerance = {"joint6": math.pi + 0.01}
    before = stuck.now()
    sent = stuck.send(goal_of(goal, path=tolerance, goal={"joint6": math.tau - 3.6 + 0.01}))
    assert stuck.outcome(sent) == (SUCCEEDED, 0, REACHED)
    errors = [(s.reference.positions[5], s.error.positions[5]) for s in stuck.states[before:]]
    beyond = [(reference, error) for reference, error in errors if reference > math.pi]
    assert beyond
    for reference, error in beyond:
        assert error == pytest.approx(reference - math.tau, abs=1e-9)
