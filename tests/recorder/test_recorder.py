"""The recorder never blocks the loop thread, and reports dropped cycles and failures."""

import logging
import threading
from collections.abc import Sequence

import pytest

from drivers.printable import counted
from servoloop.recording import recorder as module
from servoloop.recording.bus_tap import Transfer
from servoloop.recording.mcap import RecordingError
from servoloop.recording.recorder import Recorder, Sink
from servoloop.recording.sampler import CycleSample
from tests.recorder.rig import Rig


class Kept:
    """Sink that stores its samples."""

    eager = False
    complete = True

    def __init__(self) -> None:
        self.samples: list[CycleSample] = []
        self.flushed = threading.Event()
        self.closed: tuple[Sequence[Transfer], bool] | None = None

    def write(self, sample: CycleSample) -> None:
        self.samples.append(sample)

    def flush(self) -> None:
        self.flushed.set()

    def close(self, transfers: Sequence[Transfer], failed: bool) -> None:
        self.closed = transfers, failed


class Full(Kept):
    """Sink whose disk is full after one cycle."""

    def write(self, sample: CycleSample) -> None:
        if self.samples:
            raise RecordingError("cannot write the recording x.mcap: No space left on device")
        super().write(sample)


def recording(*sinks: Sink) -> tuple[Rig, Recorder]:
    rig = Rig()
    recorder = Recorder(rig.sampler, rig.taps, sinks)
    rig.stack.on_state = recorder.post
    return rig, recorder


def test_scene_is_in_the_cycle_in_which_it_was_sampled() -> None:
    kept, rig = Kept(), Rig()
    recorder = Recorder(rig.sampler, rig.taps, [kept], rig.stack.scene)
    rig.stack.on_state = recorder.post
    rig.run(0.3)
    recorder.drain()
    rig.stack.world.data.joint("cube").qpos[0] += 0.1
    rig.run(0.3)
    recorder.drain()
    seen = [{one.child: one.position_m for one in sample.scene} for sample in kept.samples]
    before, after = (places["cube"] for places in seen if places)
    assert after[0] > before[0] + 0.05 and seen[-1]["cube"] == after


def test_every_cycle_and_all_traffic_reach_every_sink_in_order() -> None:
    one, other = Kept(), Kept()
    rig, recorder = recording(one, other)
    recorder.start()
    rig.run(1.0)
    rig.stack.loop.hardware.components[0].hardware.deactivate(relax=True)
    recorder.close(failed=True)
    stamps = [sample.state.stamp_s for sample in one.samples]
    assert len(stamps) == rig.stack.loop.figures.cycles >= 20 and stamps == sorted(stamps)
    assert one.samples == other.samples
    assert one.closed is not None and one.closed == other.closed
    transfers, failed = one.closed
    assert failed and transfers[0].stamp_s >= stamps[-1] and transfers[-1].stamp_s > stamps[-1]
    assert recorder.dropped == 0


def test_the_thread_writes_while_the_loop_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "FLUSH_S", 0.001)
    sink = Kept()
    rig, recorder = recording(sink)
    recorder.start()
    rig.run(0.05)
    assert sink.flushed.wait(20.0) and sink.samples
    recorder.close(failed=False)


def test_loop_continues_without_writer_and_dropped_cycles_are_counted(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(module, "WAITING", 7)
    monkeypatch.setattr(module, "FLUSH_S", 3600.0)  # simulates a thread that waits for the disk
    sink = Kept()
    rig, recorder = recording(sink)
    recorder.start()
    rig.run(1.0)
    assert rig.stack.loop.figures.observer_errors == 0
    recorder.close(failed=False)
    assert len(sink.samples) == 7 and recorder.dropped == rig.stack.loop.figures.cycles - 7
    lost = counted(recorder.dropped, "cycle")
    assert f"the recordings lack {lost}, because the disk was too slow" in caplog.text


def test_cycles_that_only_a_viewer_misses_are_not_reported(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(module, "WAITING", 7)
    monkeypatch.setattr(module, "FLUSH_S", 3600.0)
    sink = Kept()
    sink.complete = False
    rig, recorder = recording(sink)
    recorder.start()
    rig.run(1.0)
    recorder.close(failed=False)
    assert len(sink.samples) == 7 and recorder.dropped == 0 and "lack" not in caplog.text


def test_hanging_disk_does_not_block_the_end_of_the_program(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(module, "FLUSH_S", 0.001)
    monkeypatch.setattr(module, "CLOSE_S", 0.001)
    hanging, free = threading.Event(), threading.Event()

    class Hanging(Kept):
        def write(self, sample: CycleSample) -> None:
            hanging.set()
            free.wait()

    rig, recorder = recording(Hanging())
    recorder.start()
    rig.run(0.1)
    assert hanging.wait(20.0)
    recorder.close(failed=False)
    assert "the end of the recordings is missing" in caplog.text
    free.set()


def test_failed_sink_is_removed_and_others_continue(caplog: pytest.LogCaptureFixture) -> None:
    full, other = Full(), Kept()
    rig, recorder = recording(full, other)
    rig.run(0.5)
    recorder.drain()
    rig.run(0.5)
    recorder.drain()
    assert len(other.samples) == rig.stack.loop.figures.cycles >= 20 and len(full.samples) == 1
    errors = [record for record in caplog.records if record.levelno == logging.ERROR]
    assert [record.getMessage() for record in errors] == [
        "recording stopped: cannot write the recording x.mcap: No space left on device"
    ]
