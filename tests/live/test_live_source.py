"""A running stack as a source: it ends and comes back, and one that gives no cycles is not called live."""

from pathlib import Path

import pytest

from servoloop.recording import sources as live_source
from servoloop.recording.sources import LiveSource
from servoloop.recording.stream import socket_path
from sim_backend.clock import SimulatedClock
from tests.live.rig import LiveRig, runtime_folder
from tests.servoloop.served import eventually


def test_a_stack_that_ends_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_source, "AGAIN_S", 0.01)
    with runtime_folder(monkeypatch):
        rig = LiveRig()
        source = LiveSource(None, SimulatedClock())
        eventually(lambda: rig.play(0.05) and source.connected)
        assert source.status == "robot_arm: live" and source.well
        before = source.watched
        rig.feed.close((), failed=False)
        eventually(lambda: not source.connected)
        assert "has ended" in source.status and not source.well and source.watched is before, "the last state stays"
        assert not socket_path("robot_arm", 1).exists()
        again = LiveRig(pid=2)
        eventually(lambda: again.play(0.05) and source.connected)
        assert source.watched is not before
        source.close()
        again.feed.close((), failed=False)


def test_the_stack_of_another_arm_with_the_same_name_is_not_taken_for_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(live_source, "AGAIN_S", 0.01)
    with runtime_folder(monkeypatch):
        rig = LiveRig(folder=tmp_path / "mine")
        source = LiveSource(None, SimulatedClock())
        assert source.folder == tmp_path / "mine"
        eventually(lambda: rig.play(0.05) and source.connected)
        rig.feed.close((), failed=False)
        eventually(lambda: not source.connected)
        other = LiveRig(pid=2, folder=tmp_path / "other")
        again = LiveRig(pid=3, folder=tmp_path / "mine")
        eventually(lambda: other.play(0.05) and again.play(0.05) and source.connected)
        assert again.feed.eager and not other.feed.eager
        source.close()
        for one in (other, again):
            one.feed.close((), failed=False)


def test_a_stack_that_gives_no_cycles_is_not_called_live(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = SimulatedClock()
    with runtime_folder(monkeypatch):
        rig = LiveRig()
        source = LiveSource(None, clock)
        eventually(lambda: rig.play(0.05) and source.connected)
        clock.sleep_until(3.0)
        assert not source.well
        assert source.status == "robot_arm: no cycle for 3 s. The stack is paused, or it hangs"
        eventually(lambda: rig.play(0.05) and source.status == "robot_arm: live")
        source.close()
        rig.feed.close((), failed=False)
