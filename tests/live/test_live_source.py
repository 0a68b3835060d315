"""Source for a running stack: it reconnects after a restart, and a stack that sends no cycles does not count as
live."""

import os
import socket
from pathlib import Path

import pytest

from servoloop.recording import sources as live_source
from servoloop.recording import stream
from servoloop.recording.sources import LiveSource
from servoloop.recording.stream import LiveError, find_stack, make_live_folder, open_live, socket_path
from sim_backend.clock import SimulatedClock
from tests.live.rig import LiveRig, runtime_folder
from tests.servoloop.served import eventually


def test_source_reconnects_to_a_restarted_stack(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_source, "AGAIN_S", 0.01)
    with runtime_folder(monkeypatch):
        rig = LiveRig()
        source = LiveSource(None, SimulatedClock())
        eventually(lambda: rig.play(0.05) and source.connected)
        assert source.status == "robot_arm: live" and source.up_to_date
        before = source.robot
        rig.feed.close((), failed=False)
        eventually(lambda: not source.connected)
        assert "has stopped" in source.status and not source.up_to_date
        assert source.robot is before, "the last state stays"
        assert not socket_path("robot_arm", 1).exists()
        again = LiveRig(pid=2)
        eventually(lambda: again.play(0.05) and source.connected)
        assert source.robot is not before
        source.close()
        again.feed.close((), failed=False)


def test_source_ignores_another_arm_with_the_same_name(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
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


def test_stack_without_cycles_is_not_live(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = SimulatedClock()
    with runtime_folder(monkeypatch):
        rig = LiveRig()
        source = LiveSource(None, clock)
        eventually(lambda: rig.play(0.05) and source.connected)
        clock.sleep_until(3.0)
        assert not source.up_to_date
        assert source.status == "robot_arm: no cycle for 3 s. The stack is paused or hangs"
        eventually(lambda: rig.play(0.05) and source.status == "robot_arm: live")
        source.close()
        rig.feed.close((), failed=False)


def test_a_stack_whose_queue_of_connections_is_full_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream, "CONNECT_S", 0.01)
    with runtime_folder(monkeypatch), socket.socket(socket.AF_UNIX) as paused:
        path = socket_path("so101", os.getpid())
        make_live_folder()
        paused.bind(str(path))
        paused.listen(0)
        found = find_stack("so101")  # This probe stays in the queue, because the stack does not accept it.
        with pytest.raises(
            LiveError, match=r"the stack of so101 \(process \d+\) does not accept connections: continue"
        ):
            open_live(found)
        path.unlink()
        with pytest.raises(LiveError, match="the stack of so101 has just stopped"):
            open_live(found)
