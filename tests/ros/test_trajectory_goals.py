"""Accepted and rejected goals of the default stack (ruckig), as seen from another process.

"In contrast" marks deliberate differences from ros2_control. The motion between points is tested in
test_trajectory_splines.py and test_trajectory_time.py.
"""

import math
import re
from collections.abc import Iterator
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from std_msgs.msg import String

from tests.ros.stack_process import JOINTS
from tests.ros.trajectory_client import (
    ARM,
    LATCHED,
    REACHED,
    SUCCEEDED,
    ZERO,
    TrajectoryClient,
    goal_of,
    point,
    seconds,
    trajectory,
)
from tests.ros.trajectory_stacks import LARGEST_STEP_RAD, MOCK, case, client_of, largest_step_rad

T, P = trajectory, point
NAN, INF = math.nan, math.inf
V, A = (0.2,) * 6, (0.5,) * 6


@pytest.fixture(scope="module", params=["", pytest.param("/lab/left", marks=pytest.mark.slow)])
def ours(
    request: pytest.FixtureRequest, ros_domain: int, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[TrajectoryClient]:
    with client_of(tmp_path_factory.mktemp("ours"), *MOCK, namespace=request.param) as client:
        yield client


SUCCEEDING = [
    case("one point", T(P(0.1, 0.4)), rows=["golden-one-point"]),
    case("two points", T(P(0.3, 0.4), P(0.0, 0.9)), rows=["golden-two-points"]),
    case("accelerations too", T(P(0.2, 0.4, V, A), P(0.3, 0.8, ZERO, ZERO)), rows=["golden-accelerations"]),
    case("first point at 0", T(P(-0.3, 0.0), P(0.1, 0.5)), rows=["golden-first-at-zero"]),
    case("first point before 0", T(P(0.3, -0.5), P(0.0, 0.4)), rows=["golden-negative-first"]),
    case(
        "accelerations without velocities: ours: ignored",
        T(P(0.1, 0.4, (), A)),
        rows=["golden-no-velocity", "jtc-21"],
    ),
    case(
        "permuted names",
        T(P((0.6, 0.5, 0.4, 0.3, 0.2, 0.1), 0.7), names=JOINTS[::-1]),
        rows=["jtc-5", "golden-permuted"],
    ),
    case("an allowed final velocity stops at the last point", T(P(0.4, 0.8, V)), rows=["golden-last-velocity"]),
]


@pytest.mark.row("jtc-26")
@pytest.mark.parametrize("message", SUCCEEDING)
def test_goal_succeeds_through_its_points_and_holds_the_last(ours: TrajectoryClient, message: Any) -> None:
    ours.executed(goal_of(T(P(0.1, 0.6))))  # Every case starts in the same pose.
    states = ours.executed(goal_of(message))
    assert largest_step_rad(states) <= LARGEST_STEP_RAD
    order = [list(message.joint_names).index(name) for name in states[-1].joint_names]
    assert list(states[-1].joint_names) == list(JOINTS)
    for passed in message.points[:-1]:
        nearest = min(abs(state.reference.positions[0] - passed.positions[order[0]]) for state in states)
        assert (nearest < 0.03) == (seconds(passed.time_from_start) > 0.0)  # Points before the start are skipped.
    for held in states[-2:]:
        assert list(held.output.positions) == pytest.approx([message.points[-1].positions[i] for i in order], abs=1e-6)
        assert list(held.reference.velocities) == list(ZERO)
    furthest = max(abs(position) for p in message.points for position in p.positions)
    assert max(abs(state.output.positions[0]) for state in states) <= max(0.6, furthest)


TOO_SHORT = [
    case("no time", P(1.0, 0.0), rows=["jtc-17", "golden-no-time"]),
    case("faster than the velocity limit", P(0.0, 0.1), rows=["golden-limits"]),
]


@pytest.mark.parametrize("only", TOO_SHORT)
def test_short_time_is_stretched_and_reported_in_the_result(ours: TrajectoryClient, only: Any) -> None:
    """In contrast, ros2_control jumps to the point."""
    before = ours.now()
    status, code, text = ours.outcome(ours.send(goal_of(T(only))))
    assert (status, code) == (SUCCEEDED, 0)
    assert text.startswith(
        f"{REACHED} The limits stretched the motion from {max(seconds(only.time_from_start), 0.0):.2f} s to"
    )
    ours.cycles(2)
    assert largest_step_rad(ours.states[before:]) <= LARGEST_STEP_RAD
    assert list(ours.states[-1].output.positions) == pytest.approx(list(only.positions), abs=1e-6)


MISMATCH = "Joints on incoming trajectory don't match the controller joints."
FINITE = "must be finite"
SIZE = "Mismatch between joint_names size (6) and"
EFFORT = "Trajectories with effort fields are only supported for controllers using the 'effort' command interface."
NUMBER, UNKNOWN, LENGTHS = ("jtc-2", "golden-mismatch"), ("jtc-4", "golden-unknown-name"), ("jtc-8", "golden-lengths")
TIMES, PAST, ENDLESS = ("jtc-11", "golden-times"), ("jtc-14", "golden-stamp-over"), ("jtc-41", "golden-not-finite")
REFUSED = [
    case("no names", T(P(0.1, 1.0), names=()), MISMATCH, rows=["jtc-4", "golden-mismatch"]),
    case("five names", T(P((0.1,) * 5, 1.0), names=JOINTS[:5]), MISMATCH, rows=NUMBER),
    case("seven names", T(P((0.1,) * 7, 1.0), names=(*JOINTS, "joint7")), MISMATCH, rows=NUMBER),
    case(
        "an unknown name",
        T(P(0.1, 1.0), names=(*JOINTS[:5], "foo")),
        "Incoming joint foo doesn't match the controller's joints.",
        rows=UNKNOWN,
    ),
    case(
        "a duplicate name: ours",
        T(P(0.1, 1.0), names=(*JOINTS[:5], "joint1")),
        "Joint joint1 is named twice: name each joint once.",
        rows=["jtc-6", "golden-duplicate"],
    ),
    case("no points", T(), "Empty trajectory received.", rows=["jtc-7", "golden-no-points"]),
    case("positions too short", T(P((0.1,) * 5, 1.0)), f"{SIZE} positions (5) at point #0.", rows=LENGTHS),
    case("positions too long", T(P((0.1,) * 7, 1.0)), f"{SIZE} positions (7) at point #0.", rows=LENGTHS),
    case("velocities", T(P(0.1, 1.0, (0.0,))), f"{SIZE} velocities (1) at point #0.", rows=LENGTHS),
    case("accelerations", T(P(0.1, 1.0, ZERO, (0.0,))), f"{SIZE} accelerations (1) at point #0.", rows=LENGTHS),
    case(
        "velocities only", T(P((), 1.0, ZERO)), f"{SIZE} positions (0) at point #0.", rows=["jtc-9", "golden-lengths"]
    ),
    case("efforts", T(P(0.1, 1.0, effort=ZERO)), EFFORT, rows=["jtc-10", "golden-effort"]),
    case(
        "equal times",
        T(P(0.1, 1.0), P(0.2, 1.0)),
        "Time between points 0 and 1 is not strictly increasing, it is 1.000000 and 1.000000 respectively",
        rows=TIMES,
    ),
    case(
        "decreasing times",
        T(P(0.1, 1.0), P(0.2, 0.5)),
        "Time between points 0 and 1 is not strictly increasing, it is 1.000000 and 0.500000 respectively",
        rows=TIMES,
    ),
    case(
        "trajectory has ended",
        T(P(0.1, 1.0), stamp=Time(sec=1000)),
        "Received trajectory with non-zero start time that ends in the past (",
        rows=PAST,
    ),
    case("NaN position: ours", T(P(NAN, 1.0)), f"joint1 {FINITE} at point #0, not nan", rows=ENDLESS),
    case("inf position: ours", T(P(INF, 1.0)), f"joint1 {FINITE} at point #0, not inf", rows=ENDLESS),
    case("NaN velocity: ours", T(P(0.1, 1.0, (NAN,) * 6), P(0.1, 2.0)), FINITE, rows=ENDLESS),
    case("NaN acceleration: ours", T(P(0.1, 1.0, ZERO, (NAN,) * 6), P(0.1, 2.0)), FINITE, rows=ENDLESS),
    case(
        "NaN in the middle: ours",
        T(P(0.1, 1.0), P(NAN, 2.0), P(0.1, 3.0)),
        f"joint1 {FINITE} at point #1, not nan",
        rows=ENDLESS,
    ),
    case(
        "beyond a position limit: ours",
        T(P(2.5, 9.0)),
        "joint2 would go to 2.5000 at point #0, outside its limits -2.0000 to 2.0000",
        rows=["golden-limits"],
    ),
    case(
        "beyond a velocity limit: ours",
        T(P(0.1, 1.0, (5.0,) * 6), P(0.1, 2.0)),
        "joint1 would move at 5.0000 at point #0, beyond its limit 4.0000",
        rows=["golden-limits"],
    ),
]


@pytest.mark.row("trouble-reason")
@pytest.mark.parametrize(("message", "text"), REFUSED)
def test_goal_is_rejected_with_a_reason_and_nothing_moves(ours: TrajectoryClient, message: Any, text: str) -> None:
    before = ours.now()
    assert text in ours.refusal(goal_of(message))
    assert text in ours.stack.words
    ours.cycles(1)
    assert largest_step_rad(ours.states[before:]) == 0.0


@pytest.mark.row(*PAST)
def test_recently_ended_trajectory_is_rejected_with_its_age(ours: TrajectoryClient) -> None:
    reason = ours.refusal(goal_of(T(P(0.1, 0.5), P(0.2, 1.0), stamp=ours.stamp(-1.1))))
    matched = re.search(r"with non-zero start time that ends in the past \((\d+\.\d{3}) s ago\)$", reason)
    assert matched is not None, reason
    assert float(matched[1]) >= 0.1


@pytest.mark.row("trouble-reason")
def test_late_subscriber_receives_the_last_reason(ours: TrajectoryClient) -> None:
    ours.refusal(goal_of(T()))
    heard: list[str] = []
    late = ours.node.create_subscription(
        String, f"{ARM}/rejection_reason", lambda message: heard.append(message.data), LATCHED
    )
    ours.until(lambda: bool(heard))
    ours.node.destroy_subscription(late)
    assert heard == ["goal rejected: Empty trajectory received."]


@pytest.mark.row("jtc-12", "golden-last-velocity")
def test_final_velocity_is_rejected_if_the_parameter_is_false(ours: TrajectoryClient) -> None:
    name = "allow_nonzero_velocity_at_trajectory_end"
    assert ours.set(name, False) == (True, "")
    try:
        reason = ours.refusal(goal_of(T(P(0.1, 1.0, V))))
    finally:
        assert ours.set(name, True) == (True, "")
    assert reason.endswith("Velocity of last trajectory point of joint joint1 is not zero: 0.200000000000000")


@pytest.mark.row("golden-read-only")
def test_read_only_parameter_is_refused(ours: TrajectoryClient) -> None:
    text = "parameter 'interpolation_method' cannot be set because it is read-only"
    assert ours.set("interpolation_method", "splines") == (False, text)
