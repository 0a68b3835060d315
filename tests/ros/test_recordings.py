"""Recordings of a running stack, and their messages as read by rclpy."""

import importlib
import json
import shlex
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from mcap.reader import make_reader
from rclpy.serialization import deserialize_message

from pick_place.settings import JobSettings
from servoloop.simulation.schedule import Schedule
from servoloop.simulation.simulate import simulate
from servoloop.stack.robot_files import read_files
from sim_backend.control import ask, control_path
from tests.pages import commands
from tests.recorder.reading import Messages, by_mcap, by_rosbags, faults, stamp_s
from tests.ros.stack_process import PICK, StackProcess, arm_client, emulating, running, until

DEMO_S = 110.0
OWN = "servoloop_msgs"
"""Message type without a ROS package, which rclpy cannot read."""
SCENE = "/servoloop/scene"
EVERY_CYCLE = ("/joint_states", "/servoloop/commands", "/arm_controller/controller_state", "/tf")
_, DEMO, UP, *_ = commands("recordings.md")


def check_cycles(recorded: Messages) -> int:
    """Check that every cycle is in the recording, regardless of its timing, and return the number of cycles."""
    cycles = recorded["/servoloop/cycles"]
    assert [cycle.number for cycle in cycles] == list(range(1, len(cycles) + 1))
    assert {topic: len(recorded[topic]) for topic in EVERY_CYCLE} == dict.fromkeys(EVERY_CYCLE, len(cycles) + 1)
    return len(cycles) + 1


class Recorded:
    """A recording of a stack whose servo 3 becomes silent during a motion."""

    def __init__(self, path: Path, words: str, begun_s: float) -> None:
        self.path, self.words, self.begun_s = path, words, begun_s
        self.messages = by_rosbags(path)
        self.fault_files = sorted(path.parent.glob("out/faults/*.mcap"))


@pytest.fixture(scope="module")
def recorded(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Recorded]:
    folder, begun_s = tmp_path_factory.mktemp("recorded"), time.time()
    arguments = shlex.split(UP)[2:]  # after "servoloop up"
    with pytest.MonkeyPatch.context() as patch, emulating(folder) as link:
        patch.chdir(folder)
        with running(folder, *arguments) as stack:
            with arm_client() as client:
                result = client.send(PICK)
                ask(control_path(link), {"do": "fault", "text": "silent id=3 for=2s"})
                client.wait(result)
            until(lambda: "were saved to out/faults/" in stack.words)
            assert stack.end() == 0
    yield Recorded(folder / "run.mcap", stack.words, begun_s)


@pytest.mark.slow
@pytest.mark.runs(UP)
def test_every_cycle_is_recorded_in_wall_clock_time(recorded: Recorded) -> None:
    cycles = check_cycles(recorded.messages)
    stamps = [stamp_s(message) for message in recorded.messages["/joint_states"]]
    assert stamps == sorted(stamps) and recorded.begun_s < stamps[0] < stamps[-1] < time.time()
    assert len({*stamps}) == cycles > 7, "the servo was silent for this time before its goal ended"


def test_goal_and_result_are_recorded(recorded: Recorded) -> None:
    (goal,), (result,) = (recorded.messages[f"/arm_controller/{name}"] for name in ("goal", "goal_result"))
    assert list(goal.points[0].positions) == list(PICK)
    assert result.status == "aborted" and "servo 3 does not respond" in result.error_string


def test_cube_position_is_recorded_with_an_emulated_arm(recorded: Recorded) -> None:
    places = [one for message in recorded.messages[SCENE] for one in message.transforms if one.child_frame_id == "cube"]
    assert places and places[-1].transform.translation.x == pytest.approx(0.291, abs=0.01)


def test_bus_traffic_is_recorded_from_the_first_byte(recorded: Recorded) -> None:
    """The servos are identified before the first cycle."""
    traffic = recorded.messages["/servoloop/bus_traffic"]
    assert traffic[0].sent and stamp_s(traffic[0]) < stamp_s(recorded.messages["/joint_states"][0])
    assert {message.header.frame_id for message in traffic} == {"./bus"}
    assert sum(not message.sent and len(message.data) > 0 for message in traffic) > 20


def test_fault_is_recorded_in_a_separate_file_named_in_the_log(recorded: Recorded) -> None:
    """On a slow machine, all servos may have been late before. In that case, this fault is in a later file."""
    files = {path: faults(path) for path in recorded.fault_files}
    path = next(path for path in reversed(files) if "joint3: silent" in files[path])
    assert f"{files[path][0]}: the last 30 s were saved to out/faults/{path.name}" in recorded.words
    texts = [status.message for array in by_mcap(path)["/diagnostics"] for status in array.status]
    assert "joint3: servo 3 does not respond" in texts


@pytest.mark.slow
def test_simulated_time_is_recorded(ros_domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with running(tmp_path, "--rtf", "5", "--record", "run.mcap") as stack, arm_client() as client:
        client.wait(client.send(PICK))
        assert stack.end() == 0
    messages = by_rosbags(tmp_path / "run.mcap")
    cycles = check_cycles(messages)
    stamps = [stamp_s(message) for message in messages["/joint_states"]]
    assert 0.0 <= stamps[0] < 1.0 and (stamps[-1] - stamps[0]) / (cycles - 1) == pytest.approx(0.05, rel=0.05)
    assert len(messages["/servoloop/bus_traffic"]) > 2 * cycles
    assert not (tmp_path / "out").exists(), "nothing went wrong"


def test_rclpy_reads_the_messages_of_a_recording(tmp_path: Path) -> None:
    path, read = tmp_path / "job.mcap", set()
    simulate(read_files(), {"": JobSettings()}, Schedule(job=("B",)), path)
    with path.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            assert schema is not None
            package, _, name = schema.name.split("/")
            if package == OWN:
                continue
            kind = getattr(importlib.import_module(f"{package}.msg"), name)
            decoded = deserialize_message(message.data, kind)
            read.add(channel.topic)
            if channel.topic == "/arm_controller/controller_state":
                assert len(decoded.reference.positions) == 6 and decoded.speed_scaling_factor == 1.0
    assert read == {*EVERY_CYCLE, "/arm_controller/goal", "/diagnostics", "/robot_description", "/tf_static", SCENE}


@pytest.mark.slow
@pytest.mark.runs(DEMO)
def test_demo_is_recorded_from_first_to_last_cycle(
    ros_domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    demo = StackProcess(tmp_path / "demo.log", *shlex.split(DEMO)[1:])
    assert demo.process.wait(DEMO_S) == 0, demo.words
    by_others = by_mcap(tmp_path / "demo.mcap")
    messages = by_rosbags(tmp_path / "demo.mcap")
    assert {topic: len(found) for topic, found in by_others.items()} == {t: len(found) for t, found in messages.items()}
    result = json.loads((tmp_path / "out" / "demo" / "result.json").read_text())
    assert check_cycles(messages) >= result["loop"]["cycles"]
    assert len(messages["/arm_controller/goal"]) == len(messages["/arm_controller/goal_result"]) >= 3
