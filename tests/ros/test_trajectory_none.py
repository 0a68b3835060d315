"""The parameter ``interpolation_method: none``, as seen from another process."""

from collections.abc import Iterator

import pytest

from tests.ros.trajectory_client import TrajectoryClient, goal_of, point, seconds, stamp_s, trajectory
from tests.ros.trajectory_stacks import LARGEST_STEP_RAD, largest_step_rad, plain_client, rises


@pytest.fixture
def stepping(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[TrajectoryClient]:
    with plain_client(tmp_path_factory.mktemp("none"), "interpolation_method: none") as client:
        yield client


@pytest.mark.row("jtc-22")
def test_arm_waits_for_the_time_of_the_first_point_and_moves_to_the_next(stepping: TrajectoryClient) -> None:
    """In contrast to ros2_control, each jump becomes a motion at the velocity limit."""
    sent_s = seconds(stepping.stamp(0.0))
    states = stepping.executed(goal_of(trajectory(point(0.1, 0.3), point(0.5, 0.6), point(0.9, 0.9))))
    wanted = [state.reference.positions[0] for state in states]
    assert sorted(set(wanted)) == [0.0, 0.5, 0.9] and wanted == sorted(wanted)
    for position_rad, after_s in ((0.5, 0.3), (0.9, 0.6)):
        assert stamp_s(states[wanted.index(position_rad)]) > sent_s + after_s
    reached = [state.feedback.positions[0] for state in states]
    assert rises(reached) and largest_step_rad(states) <= LARGEST_STEP_RAD
    assert reached[-1] == pytest.approx(0.9, abs=1e-9)
