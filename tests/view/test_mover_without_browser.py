"""Held buttons move the arm of a running stack over its command socket. The browser is left out."""

import time
from collections.abc import Iterator

import pytest

from drivers.clock import MonotonicClock
from servoloop.dashboard.move_panel import STOPPED, Mover
from servoloop.manual.buttons import REPEATS_HZ, Turn
from servoloop.recording.sources import LiveSource
from tests.command_socket.rig import SocketRig, served
from tests.command_socket.test_bad_clients import at_rest
from tests.servoloop.served import eventually
from tests.stack.rig import READY


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch) -> Iterator[SocketRig]:
    with served(monkeypatch) as rig:
        yield rig


@pytest.fixture
def mover(rig: SocketRig) -> Iterator[Mover]:
    clock = MonotonicClock()
    source = LiveSource(None, clock)
    mover = Mover(source, clock)
    try:
        eventually(lambda: "joint1" in mover.targets.joints)
        yield mover
    finally:
        mover.close()
        source.close()


def hold(mover: Mover, seconds: float) -> None:
    """Hold the button of a joint."""
    for _ in range(round(seconds * REPEATS_HZ)):
        mover.buttons.hold("browser", Turn("joint1", 1.0))
        time.sleep(1.0 / REPEATS_HZ)
    mover.buttons.release("browser")


def test_arm_moves_while_a_button_is_held(rig: SocketRig, mover: Mover) -> None:
    hold(mover, 1.5)
    moved = at_rest(rig)[0]
    assert moved > 0.02 and mover.message.startswith("moving joint1")
    with rig.client("other") as other:
        eventually(lambda: not other.request("state")["owner"])


def test_goal_of_another_program_is_named_and_the_stop_button_ends_it(rig: SocketRig, mover: Mover) -> None:
    goal = rig.stack.go(READY, 3000.0)
    eventually(lambda: rig.stack.arm.newest_goal is goal)
    hold(mover, 1.0)
    assert "arm_controller is executing a goal: stop the goal first" in mover.message
    mover.stop()
    eventually(lambda: goal.done and mover.message == STOPPED)
    hold(mover, 1.5)
    assert at_rest(rig)[0] > 0.02
