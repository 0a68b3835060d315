"""The code paths of a goal and of a reply stay short enough to read in an afternoon."""

import re
import threading
from pathlib import Path

import pytest

from controller.trajectory.goal import TrajectoryGoal
from servoloop.simulation.stack import SimulatedStack
from tests.stack.trip import (
    ONE_POINT,
    THREE_POINTS,
    TripRecorder,
    goal_to_wire,
    lines_of,
    reply_to_joint_states,
)


def up() -> SimulatedStack:
    rig = SimulatedStack().up()
    rig.run(3.0)  # the arm rests
    return rig


def of_controller(files: list[str]) -> list[str]:
    return [name for name in files if name.startswith("controller/")]


def of_hal(files: list[str]) -> list[str]:
    return [name for name in files if name.startswith("hal/")]


@pytest.mark.parametrize(("goal", "files"), [(ONE_POINT, 9), (THREE_POINTS, 11)])
def test_a_goal_passes_few_files_of_controller(goal: TrajectoryGoal, files: int) -> None:
    trip = of_controller(goal_to_wire(up(), goal))
    assert trip[0] == "controller/trajectory/joint_trajectory_controller.py"
    assert trip.index("controller/trajectory/goal_planner.py") < trip.index("controller/loop.py")
    assert len(trip) <= files, trip


def test_a_goal_passes_few_files_of_hal() -> None:
    trip = of_hal(goal_to_wire(up()))
    assert trip[0] == "hal/gate.py"
    assert len(trip) <= 7, trip


def test_a_reply_passes_few_files_of_hal() -> None:
    trip = of_hal(reply_to_joint_states(up()))
    assert trip[0] == "hal/components/component_set.py"
    assert len(trip) <= 6, trip


def test_both_paths_are_short_enough_to_read_in_an_afternoon() -> None:
    """The path of a goal also has five files in nodes/, which are not counted here."""
    down, rising = goal_to_wire(up()), reply_to_joint_states(up())
    assert len(down) <= 21 and len(rising) <= 15
    assert lines_of(down) <= 2924 and lines_of(rising) <= 2410


def test_a_reply_passes_few_files_of_controller() -> None:
    trip = of_controller(reply_to_joint_states(up()))
    assert trip[-1] == "controller/broadcasters/joint_state_broadcaster.py"
    assert len(trip) <= 4, trip


def test_goal_path_ends_and_reply_path_begins_at_the_port() -> None:
    down = goal_to_wire(up())
    assert down[-1].startswith("drivers/") and "hal/gate.py" in down
    assert not any(name.startswith(("tests/", "sim_backend/")) for name in down)
    assert not any("broadcaster" in name or "forward" in name for name in down)
    rising = reply_to_joint_states(up())
    assert "hal/gate.py" not in rising and not any("trajectory" in name for name in rising)


def listed(heading: str) -> set[str]:
    """Return the files in one of the lists in docs/architecture.md."""
    _, _, rest = (Path(__file__).parents[2] / "docs" / "architecture.md").read_text().partition(f"<!-- {heading} -->\n")
    return set(re.findall(r"^\d+\. `(.*)`$", rest.partition("\n\n")[0], flags=re.MULTILINE))


def test_architecture_page_lists_the_files_on_both_paths() -> None:
    assert listed("goal to wire") == set(goal_to_wire(up()))
    assert listed("reply to joint states") == set(reply_to_joint_states(up()))


def test_trip_recorder_sees_new_threads_but_not_muted_code() -> None:
    rig = up()
    trip = TripRecorder(muted=[type(rig.loop.hardware).read])
    with trip.recording():
        thread = threading.Thread(target=rig.loop.step)
        thread.start()
        thread.join()
    assert "controller/loop.py" in trip.files
    assert "hal/components/component_set.py" in trip.files  # its write
    begun = list(trip.files)
    rig.loop.step()
    assert trip.files == begun
