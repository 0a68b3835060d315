"""Recording of a simulated job: independent readers find every cycle and byte, and the run itself is unchanged."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from pick_place.settings import JobSettings
from servoloop.recording.message_types import MSG, definition, typestore
from servoloop.recording.messages import Messages
from servoloop.recording.recorder import RecordingFile
from servoloop.recording.sampler import CycleSample
from servoloop.simulation.schedule import Schedule
from servoloop.simulation.simulate import SimulationResult, recorded, simulate
from servoloop.simulation.stack import SimulatedStack
from servoloop.stack.robot_files import read_files
from sim_backend.faults.text import parse
from tests.complaint import complaint
from tests.recorder.reading import Messages as Read
from tests.recorder.reading import by_mcap, by_rosbags, stamp_s
from tests.recorder.rig import Rig
from tests.stack.rig import PICK

ROOT = Path(__file__).parents[2]
SCHEDULE = Schedule(seed=1, job=("B",), seconds=1.5, faults=(parse("silent id=3 at=13.1s for=1s"),))
TOPICS = {
    "/robot_description": "std_msgs/msg/String",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/joint_states": "sensor_msgs/msg/JointState",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    "/arm_controller/controller_state": "control_msgs/msg/JointTrajectoryControllerState",
    "/arm_controller/goal": "trajectory_msgs/msg/JointTrajectory",
    "/arm_controller/goal_result": "servoloop_msgs/msg/GoalResult",
    "/servoloop/commands": "sensor_msgs/msg/JointState",
    "/servoloop/cycles": "servoloop_msgs/msg/Cycle",
    "/servoloop/scene": "tf2_msgs/msg/TFMessage",
    "/servoloop/bus_traffic": "servoloop_msgs/msg/BusTraffic",
}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[SimulationResult, Path]:
    path = tmp_path_factory.mktemp("recording") / "job.mcap"
    return simulate(read_files(), {"": JobSettings()}, SCHEDULE, path), path


@pytest.fixture(scope="module", params=[by_rosbags, by_mcap])
def read(request: pytest.FixtureRequest, run: tuple[SimulationResult, Path]) -> Iterator[Read]:
    yield request.param(run[1])


@pytest.mark.slow
def test_the_digest_is_the_same_with_and_without_a_recording(run: tuple[SimulationResult, Path]) -> None:
    assert simulate(read_files(), {"": JobSettings()}, SCHEDULE).digest == run[0].digest


def test_both_readers_find_all_topics(read: Read, run: tuple[SimulationResult, Path]) -> None:
    assert set(read) == set(TOPICS)
    result = run[0]
    assert result.faulty_cycles["joint3: silent"] >= 15, "the schedule's fault is in the recording"


def test_every_cycle_is_there_at_its_simulated_time(read: Read, run: tuple[SimulationResult, Path]) -> None:
    for topic in ("/joint_states", "/servoloop/commands", "/tf", "/arm_controller/controller_state"):
        assert len(read[topic]) == run[0].cycles, topic
    stamps = [stamp_s(message) for message in read["/joint_states"]]
    steps = np.diff(stamps)
    assert np.median(steps) == pytest.approx(0.05) and steps.min() > 0.0 and stamps[-1] < run[0].simulated_s
    cycles = read["/servoloop/cycles"]
    assert [cycle.number for cycle in cycles] == list(range(1, run[0].cycles))
    assert [stamp_s(cycle) for cycle in cycles] == pytest.approx(stamps[:-1])
    assert all(0.0 < cycle.busy_s < 0.05 for cycle in cycles)


def test_goals_begin_and_end(read: Read) -> None:
    goals, results = read["/arm_controller/goal"], read["/arm_controller/goal_result"]
    assert len(goals) == len(results) > 0
    assert {result.status for result in results} == {"succeeded"}
    assert list(goals[0].joint_names) == [f"joint{number}" for number in range(1, 7)]
    for goal, result in zip(goals, results, strict=True):
        lasts = goal.points[-1].time_from_start
        assert stamp_s(result) - stamp_s(goal) >= lasts.sec + lasts.nanosec * 1e-9 - 0.1


def test_diagnostics_name_the_joint_that_was_silent(read: Read) -> None:
    texts = [status.message for array in read["/diagnostics"] for status in array.status]
    assert "joint3: servo 3 does not respond" in texts
    names = [status.name for status in read["/diagnostics"][0].status]
    assert "servoloop: control loop" in names and "servoloop: joint3 (servo 3)" in names


def test_recorded_commands_equal_the_controller_output(read: Read) -> None:
    """The safety gate changed no command in this job."""
    commands, states = read["/servoloop/commands"], read["/arm_controller/controller_state"]
    for command, state in zip(commands, states, strict=True):
        assert list(command.position)[:6] == pytest.approx(list(state.output.positions))


def test_bus_traffic_has_every_byte_in_order(tmp_path: Path) -> None:
    stack, path = SimulatedStack(), tmp_path / "bus.mcap"
    with recorded(stack, path):
        stack.up().run(0.5)
        stack.manager.deactivate()
        stack.loop.hardware.components[0].hardware.deactivate(relax=False)  # after the last cycle
    traffic = by_rosbags(path)["/servoloop/bus_traffic"]
    (port,) = stack.ports.values()
    for sent, transfers in ((True, port.sent), (False, port.received)):
        mine = [message for message in traffic if message.sent is sent]
        assert [bytes(message.data) for message in mine] == [data for _, data in transfers]
        assert [stamp_s(message) for message in mine] == pytest.approx([time_s for time_s, _ in transfers])
    assert {message.header.frame_id for message in traffic} == {port.name}
    assert [stamp_s(message) for message in traffic] == sorted(stamp_s(message) for message in traffic)


def test_recording_has_links_and_description_of_the_robot(read: Read) -> None:
    (description,) = read["/robot_description"]
    assert description.data == read_files().description.xml
    state, transforms = read["/joint_states"][-1], read["/tf"][-1].transforms
    assert len(transforms) == 8, "six joints and both fingers"
    joint1 = transforms[0]
    assert (joint1.header.frame_id, joint1.child_frame_id) == ("base_link", "link1")
    assert joint1.transform.rotation.z == pytest.approx(np.sin(state.position[0] / 2.0))


def test_recording_has_the_cube_from_the_stand_to_its_bin(read: Read) -> None:
    """Poses are in the world frame and belong to the cycle with which they are recorded."""
    scenes = [{one.child_frame_id: one.transform for one in message.transforms} for message in read["/servoloop/scene"]]
    assert len(scenes) == len(read["/joint_states"]) and set(scenes[0]) == {"cube", "bin_A", "bin_B", "bin_C"}
    assert {one.header.frame_id for one in read["/servoloop/scene"][0].transforms} == {"base_link"}
    begin, end = (np.array([place.x, place.y]) for place in (s["cube"].translation for s in (scenes[0], scenes[-1])))
    bin_b = scenes[-1]["bin_B"].translation
    assert np.linalg.norm(begin - (0.291, 0.0)) < 0.005
    assert np.linalg.norm(end - (bin_b.x, bin_b.y)) < 0.1 and np.linalg.norm(end - begin) > 0.05


def test_nothing_is_compiled_while_the_loop_runs(tmp_path: Path) -> None:
    """Compilation in the recorder thread once delayed the loop by 33 ms."""
    rig = Rig()
    compiled = set(typestore().cache)
    assert set(TOPICS.values()) <= compiled
    rig.stack.go(PICK)
    file = RecordingFile(tmp_path / "run.mcap", rig.messages)
    for sample in rig.run(3.0):
        file.write(sample)
    file.close()
    assert set(typestore().cache) == compiled


@pytest.mark.parametrize("kind", sorted(set(TOPICS.values())))
def test_schemas_contain_all_types(kind: str) -> None:
    text = definition(kind)
    assert kind == "std_msgs/msg/String" or "MSG: " in text
    assert kind in typestore().types


def test_definitions_equal_those_of_the_message_package() -> None:
    for path in MSG.glob("control_msgs/*.msg"):
        assert path.read_text() == (ROOT / "interfaces" / "control_msgs" / "msg" / path.name).read_text()


def test_objects_in_a_sample_are_never_changed_later() -> None:
    """Samples are encoded in another thread, or 30 seconds later."""
    rig = Rig()
    (first, *_) = rig.run(0.05)
    at_once = _encoded(rig.messages, first)
    rig.run(2.0)
    assert _encoded(rig.messages, first) == at_once


def _encoded(messages: Messages, sample: CycleSample) -> list[bytes]:
    return [bytes(typestore().serialize_cdr(one.message, one.kind)) for one in messages.of_cycle(sample)]


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("run.bag", "end in .mcap"),
        ("nowhere/run.mcap", "does not exist"),
        ("there.mcap", "already exists: choose another file"),
    ],
)
@pytest.mark.parametrize("verb", ["simulate", "up", "demo"])
def test_invalid_recording_path_is_refused_before_anything_moves(
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    path: str,
    words: str,
    verb: str,
) -> None:
    (tmp_path / "there.mcap").touch()
    monkeypatch.chdir(tmp_path)
    assert words in complaint(capsys, monkeypatch, verb, "--record", path)
