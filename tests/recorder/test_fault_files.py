"""Fault recordings: the time before each fault is recorded in a file, and the number of files is limited."""

from datetime import datetime, timedelta
from itertools import count
from pathlib import Path

import pytest

from hal.lifecycle import LifecycleState
from servoloop.recording.fault_files import FILES, KEPT_S, FaultFiles, tidy
from tests.recorder.reading import by_rosbags, faults, stamp_s
from tests.recorder.rig import Rig
from tests.stack.rig import PICK, READY


class FaultRig(Rig):
    """Stack whose faults are written to a folder."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self.folder = folder
        numbers = count()
        begin = datetime(2026, 1, 31, 12)
        self.sink = FaultFiles(folder, self.messages, lambda: begin + timedelta(seconds=next(numbers)))

    @property
    def files(self) -> list[Path]:
        return sorted(self.folder.glob("*"))

    def pass_on(self, seconds: float) -> None:
        """Run for a given time, and deliver the cycles in groups, as the thread of the recorder receives them."""
        for _ in range(round(seconds / 0.5)):
            for sample in self.run(0.5):
                self.sink.write(sample)
            self.sink.flush()

    def silence(self, servo_id: int) -> None:
        self.stack.bus.faults.silence(servo_id)

    def heal(self) -> None:
        for servo_id in range(1, 8):
            self.stack.bus.faults.restore(servo_id)


@pytest.fixture
def rig(tmp_path: Path) -> FaultRig:
    return FaultRig(tmp_path / "out" / "faults")


def test_nothing_is_written_without_faults(rig: FaultRig) -> None:
    rig.stack.go(PICK)
    rig.pass_on(3.0)
    rig.sink.close((), failed=False)
    assert not rig.folder.exists()


def test_servos_silent_for_one_late_cycle_are_not_a_fault(rig: FaultRig) -> None:
    rig.stack.go(PICK)
    rig.pass_on(0.5)
    for servo_id in range(1, 8):
        rig.silence(servo_id)
    samples = rig.run(0.2)
    rig.heal()
    assert any(len(sample.state.faults) == 7 for sample in samples)
    for sample in samples:
        rig.sink.write(sample)
    rig.pass_on(3.0)
    assert rig.files == []


@pytest.mark.slow
def test_silent_servo_writes_the_time_before_the_fault(rig: FaultRig, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO")
    rig.pass_on(40.0)
    rig.silence(3)
    rig.pass_on(1.0)
    (path,) = rig.files
    assert path.name == "2026-01-31_12-00-00.000_joint3_silent.mcap"
    assert f"joint3: silent: the last 30 s were saved to {path}" in caplog.text
    assert faults(path) == ["joint3: silent"]
    stamps = [stamp_s(message) for message in by_rosbags(path)["/joint_states"]]
    assert stamps[-1] - stamps[0] == pytest.approx(KEPT_S, abs=0.1)
    texts = [status.message for array in by_rosbags(path)["/diagnostics"] for status in array.status]
    assert "joint3: servo 3 does not respond" in texts


@pytest.mark.slow
def test_later_faults_are_in_a_second_file_without_a_gap(rig: FaultRig) -> None:
    rig.pass_on(5.0)
    for servo_id in (3, 5, 6):  # each servo answers again before the next one becomes silent
        rig.silence(servo_id)
        rig.pass_on(1.0)
        rig.heal()
        rig.pass_on(3.0)
    assert len(rig.files) == 1
    rig.pass_on(40.0)
    first, second = rig.files
    assert faults(first) == ["joint3: silent"] and faults(second) == ["joint5: silent", "joint6: silent"]
    end_s, begin_s = (stamp_s(by_rosbags(path)["/joint_states"][at]) for path, at in ((first, -1), (second, 0)))
    assert begin_s <= end_s + 0.06


def test_pending_fault_is_written_at_the_end(rig: FaultRig) -> None:
    rig.silence(3)
    rig.pass_on(1.0)
    rig.silence(4)
    rig.pass_on(1.0)
    rig.sink.close((), failed=True)
    assert faults(rig.files[-1]) == ["joint4: silent", "loop: ended by an error"]


def test_violated_goal_tolerance_is_a_fault(rig: FaultRig) -> None:
    rig.stack.go(PICK)
    rig.pass_on(0.5)
    rig.silence(3)
    rig.pass_on(0.5)
    (path,) = rig.files
    silent, goal = faults(path)
    assert silent == "joint3: silent" and goal.startswith("arm_controller: ")
    (result,) = by_rosbags(path)["/arm_controller/goal_result"]
    assert (result.status, result.error_code) == ("aborted", -4) and f"arm_controller: {result.error_string}" == goal


def test_replaced_goal_is_not_a_fault(rig: FaultRig) -> None:
    rig.stack.go(PICK)
    rig.pass_on(0.5)
    rig.stack.go(READY)
    rig.pass_on(3.0)
    assert rig.files == []


def test_a_lost_component_is_a_fault(rig: FaultRig) -> None:
    rig.pass_on(1.0)
    rig.stack.virtual_port.unplug()
    rig.pass_on(1.0)
    (path,) = rig.files
    assert faults(path)[0] == "robot_arm: lost"


def test_component_switched_off_by_a_client_is_not_a_fault(rig: FaultRig) -> None:
    rig.pass_on(1.0)
    rig.stack.loop.component_transitions.ask("robot_arm", LifecycleState.UNCONFIGURED)
    rig.pass_on(1.0)
    assert {fault.kind for fault in rig.samples[-1].state.faults.values()} == {"component"}
    assert rig.files == []


def test_oldest_files_are_deleted_first(rig: FaultRig) -> None:
    rig.folder.mkdir(parents=True)
    (rig.folder / "notes.txt").touch()
    old = [rig.folder / f"2025-12-{day:02d}_00-00-00.000_joint1_silent.mcap" for day in range(1, FILES + 1)]
    for path in old:
        path.touch()
    rig.silence(3)
    rig.pass_on(0.5)
    assert not old[0].exists() and all(path.exists() for path in old[1:])
    assert len(rig.files) == FILES + 1 and (rig.folder / "notes.txt").exists()


@pytest.mark.parametrize(("sizes", "kept"), [([10] * 25, FILES), ([60, 60, 60, 30], 2), ([10, 500], 1)])
def test_folder_is_limited_in_number_and_size_of_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sizes: list[int], kept: int
) -> None:
    monkeypatch.setattr("servoloop.recording.fault_files.LARGEST_FOLDER", 200 if len(sizes) > 20 else 100)
    names = [f"2026-01-31_12-00-{number:02}.000_x.mcap" for number in range(len(sizes))]
    for name, size in zip(names, sizes, strict=True):
        (tmp_path / name).write_bytes(b"x" * size)
    tidy(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == names[-kept:]
