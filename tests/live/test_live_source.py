"""A running stack as a source: it ends and comes back, and one that gives no cycles is not called live."""

import pytest

from servoloop.live import live_source
from servoloop.live.folder import socket_path
from servoloop.live.live_source import LiveSource
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
