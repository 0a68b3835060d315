"""``servoloop record``: the file of a running stack is what ``--record`` would have written from then on."""

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from mcap.reader import NonSeekingReader

from servoloop.recording import feed as viewer
from servoloop.recording import stack_recording as live_recording
from servoloop.recording.bus_tap import Transfer
from servoloop.recording.mcap import RecordingError
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
    """``record`` of the stack that runs, in a thread."""

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
    """All that is in a file: topic, type and its text, time and bytes of each message."""
    with path.open("rb") as stream:
        messages = NonSeekingReader(stream).iter_messages(log_time_order=False)
        return [(c.topic, s.name, s.data, m.log_time, m.data) for s, c, m in messages if s is not None]


def test_it_is_byte_for_byte_what_record_writes_from_then_on(tmp_path: Path) -> None:
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


def test_two_readers_read_it_to_the_end_without_a_gap(tmp_path: Path) -> None:
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


def test_it_ends_by_itself_behind_so_many_seconds_of_the_stacks_time(tmp_path: Path) -> None:
    rig = LiveRig()
    recording = Recording(tmp_path / "live.mcap", seconds=1.002)
    rig.play(1.5)
    done = recording.to_its_end()
    assert (done.cycles, done.stack_ended) == (21, False) and done.length_s == pytest.approx(1.0, abs=0.002)
    assert len(by_rosbags(tmp_path / "live.mcap")["/tf"]) == 21
    rig.feed.close((), failed=False)


def test_told_to_stop_it_ends_with_a_whole_cycle_also_where_no_more_cycles_come(
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


def test_told_to_stop_it_ends_though_cycles_come_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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
def test_cycles_for_which_it_was_too_slow_are_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(viewer, "BEHIND", 20_000)
    rig = LiveRig()
    stream = open_live(find_stack())
    cycles = rig.play(20.0)  # more than the socket takes
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


def test_goals_that_had_ended_before_are_not_in_it_and_one_under_way_is(tmp_path: Path) -> None:
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
    with pytest.raises(RecordingError, match="not one cycle has come"):
        recording.to_its_end()
    assert not (tmp_path / "live.mcap").exists()
    rig.feed.close((), failed=False)
