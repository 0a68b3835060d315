"""``servoloop record`` of a running stack writes the same file as the option ``--record``."""

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from mcap.reader import NonSeekingReader

from servoloop.recording import feed
from servoloop.recording import stack_recording as live_recording
from servoloop.recording.bus_tap import Transfer
from servoloop.recording.mcap import McapFile, RecordingError
from servoloop.recording.recorder import RecordingFile
from servoloop.recording.stack_recording import RecordedCycles, record
from servoloop.recording.stream import find_stack, open_live
from tests.live.rig import LiveRig, runtime_folder
from tests.recorder.reading import by_mcap, by_rosbags
from tests.servoloop.served import eventually
from tests.stack.rig import READY

LAST = [Transfer(9.0, "bus", True, b"last")]


@pytest.fixture(autouse=True)
def folder(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    with runtime_folder(monkeypatch):
        yield


class Recording:
    """Thread that records the running stack."""

    def __init__(self, path: Path, seconds: float | None = None) -> None:
        self.stopped = threading.Event()
        self._done: list[RecordedCycles | RecordingError] = []
        stream = open_live(find_stack())

        def work() -> None:
            try:
                self._done.append(record(stream, path, seconds, self.stopped.is_set))
            except RecordingError as error:
                self._done.append(error)

        self.thread = threading.Thread(target=work)
        self.thread.start()

    def to_its_end(self) -> RecordedCycles:
        self.thread.join(30.0)
        (done,) = self._done
        if isinstance(done, RecordingError):
            raise done
        return done


def raw(path: Path) -> list[tuple[str, str, bytes, int, bytes]]:
    """Return the contents of a file: topic, type, definition, time and bytes of each message."""
    with path.open("rb") as stream:
        messages = NonSeekingReader(stream).iter_messages(log_time_order=False)
        return [(c.topic, s.name, s.data, m.log_time, m.data) for s, c, m in messages if s is not None]


def test_a_recording_that_cannot_begin_leaves_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Failing(live_recording._LiveRecording):
        def __init__(self, *_: object) -> None:
            raise KeyboardInterrupt

    rig, path = LiveRig(), tmp_path / "live.mcap"
    monkeypatch.setattr(live_recording, "_LiveRecording", Failing)
    with pytest.raises(KeyboardInterrupt):
        record(open_live(find_stack()), path, None, lambda: False)
    rig.feed.close((), failed=False)
    assert not path.exists()


def test_live_recording_equals_the_output_of_record_option(tmp_path: Path) -> None:
    rig = LiveRig()
    rig.play(0.3)
    recording = Recording(tmp_path / "live.mcap")
    rig.stack.go([*READY[:5], READY[5] + 0.2], 0.5)
    begun = len(rig.samples)
    cycles = rig.play(1.5)
    rig.feed.close(LAST, failed=False)
    done = recording.to_its_end()
    assert (done.cycles, done.lost_cycles, done.stack_ended) == (cycles, 0, True)
    assert done.length_s == pytest.approx(rig.samples[-1].state.stamp_s - rig.samples[begun].state.stamp_s)
    whole = RecordingFile(tmp_path / "whole.mcap", rig.messages)
    for sample in rig.samples[begun:]:
        whole.write(sample)
    whole.close(LAST)
    assert raw(tmp_path / "live.mcap") == raw(tmp_path / "whole.mcap")


def test_two_readers_read_live_recording_without_gaps(tmp_path: Path) -> None:
    rig = LiveRig()
    recording = Recording(tmp_path / "live.mcap")
    cycles = rig.play(1.0)
    rig.feed.close((), failed=False)
    recording.to_its_end()
    for read in (by_rosbags, by_mcap):
        found = read(tmp_path / "live.mcap")
        for topic in ("/joint_states", "/servoloop/commands", "/arm_controller/controller_state", "/tf"):
            assert len(found[topic]) == cycles, topic
        numbers = [cycle.number for cycle in found["/servoloop/cycles"]]
        assert numbers == list(range(numbers[0], numbers[0] + len(numbers))) and len(numbers) >= cycles - 1
        assert len(found["/robot_description"]) == len(found["/tf_static"]) == 1


def test_recording_ends_after_its_duration_in_stack_time(tmp_path: Path) -> None:
    rig = LiveRig()
    recording = Recording(tmp_path / "live.mcap", seconds=1.002)
    rig.play(1.5)
    done = recording.to_its_end()
    assert (done.cycles, done.stack_ended) == (21, False) and done.length_s == pytest.approx(1.0, abs=0.002)
    assert len(by_rosbags(tmp_path / "live.mcap")["/tf"]) == 21
    rig.feed.close((), failed=False)


def test_stopped_recording_ends_with_a_complete_cycle_without_further_cycles(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_recording, "FLUSH_S", 0.1)
    rig = LiveRig()
    recording = Recording(tmp_path / "live.mcap")
    rig.play(0.5)
    recording.stopped.set()
    done = recording.to_its_end()
    found = by_rosbags(tmp_path / "live.mcap")
    assert not done.stack_ended and len(found["/joint_states"]) == len(found["/tf"]) == done.cycles > 0
    rig.feed.close((), failed=False)


def test_stopped_recording_ends_while_cycles_continue(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_recording, "FLUSH_S", 60.0)
    rig = LiveRig()
    recording = Recording(tmp_path / "live.mcap")
    rig.play(0.2)
    recording.stopped.set()
    eventually(lambda: rig.play(0.05) and not recording.thread.is_alive())
    done = recording.to_its_end()
    assert len(by_rosbags(tmp_path / "live.mcap")["/tf"]) == done.cycles > 0
    rig.feed.close((), failed=False)


@pytest.mark.slow
def test_lost_cycles_are_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(feed, "MAX_QUEUE_BYTES", 20_000)
    rig = LiveRig()
    stream = open_live(find_stack())
    cycles = rig.play(20.0)  # more cycles than the socket can buffer
    thread_done: list[RecordedCycles] = []
    thread = threading.Thread(
        target=lambda: thread_done.append(record(stream, tmp_path / "live.mcap", None, lambda: False))
    )
    thread.start()
    rig.wait_until_read()
    cycles += rig.play(0.2)
    rig.feed.close((), failed=False)
    thread.join(30.0)
    (done,) = thread_done
    assert 4 <= done.cycles < cycles and done.lost_cycles == cycles - done.cycles


def test_recording_has_running_goals_but_not_past_goals(tmp_path: Path) -> None:
    rig = LiveRig()
    rig.stack.go([*READY[:5], READY[5] + 0.2], 0.5)
    rig.play(1.5)
    after = Recording(tmp_path / "after.mcap")
    rig.play(0.2)
    rig.stack.go([*READY[:5], READY[5]], 1.0)
    rig.play(0.2)
    during = Recording(tmp_path / "during.mcap")
    rig.play(2.0)
    rig.feed.close((), failed=False)
    for recording, name in ((after, "after"), (during, "during")):
        recording.to_its_end()
        found = by_rosbags(tmp_path / f"{name}.mcap")
        (goal,), (result,) = found["/arm_controller/goal"], found["/arm_controller/goal_result"]
        assert goal.points[0].positions[5] == READY[5] and result.status == "succeeded"


def test_a_stack_without_a_cycle_leaves_no_file(tmp_path: Path) -> None:
    rig = LiveRig()
    recording = Recording(tmp_path / "live.mcap")
    recording.stopped.set()
    with pytest.raises(RecordingError, match="no cycles arrived"):
        recording.to_its_end()
    assert not (tmp_path / "live.mcap").exists()
    rig.feed.close((), failed=False)


@pytest.mark.parametrize("cycles", [False, True])
def test_after_a_write_error_only_a_file_with_cycles_remains(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cycles: bool
) -> None:
    rig, path, flush, full = LiveRig(), tmp_path / "live.mcap", McapFile.flush, threading.Event()

    def flush_until_full(file: McapFile) -> None:
        if full.is_set():
            raise RecordingError(f"cannot write the recording {path}: No space left on device")
        flush(file)

    monkeypatch.setattr(McapFile, "flush", flush_until_full)
    monkeypatch.setattr(live_recording, "FLUSH_S", live_recording.POLL_S)
    recording = Recording(path)
    if cycles:
        eventually(lambda: rig.play(0.05) and path.stat().st_size > 20_000)
    full.set()
    with pytest.raises(RecordingError, match="No space left"):
        recording.to_its_end()
    assert path.exists() == cycles
    rig.feed.close((), failed=False)
