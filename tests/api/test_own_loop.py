"""A loop that a script runs itself shuts the arm down completely, even after a signal. The loop runs in real time, with
mock joints."""

import signal
import threading
from collections.abc import Callable, Iterator

import pytest

from hal.lifecycle import LifecycleState
from hal.mock_hardware import MockHardware
from servoloop import Arm
from servoloop.api.own_loop import OwnLoop
from servoloop.stack import hardware
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.control_stack import ControlStack
from servoloop.stack.hardware import HardwareKind
from servoloop.stack.loop_thread import LoopThread

Hurry = Callable[[], bool]


def test_a_loop_without_a_shutdown_cannot_be_created() -> None:
    with pytest.raises(TypeError, match="close"):
        OwnLoop(read_arm_files(find_arm("so101")))  # type: ignore[abstract]


@pytest.fixture
def mocks(monkeypatch: pytest.MonkeyPatch) -> list[MockHardware]:
    """All mock joints that the test creates, which replace the servos."""
    made: list[MockHardware] = []
    create = MockHardware.__init__

    def created(mock: MockHardware, *arguments: object, **options: object) -> None:
        create(mock, *arguments, **options)  # type: ignore[arg-type]
        made.append(mock)

    monkeypatch.setattr(MockHardware, "__init__", created)
    monkeypatch.setattr(hardware, "choose", lambda kind, component: HardwareKind.MOCK)
    return made


@pytest.fixture
def arm(mocks: list[MockHardware]) -> Iterator[Arm]:
    arm = Arm("so101")
    yield arm
    arm.close()


def ended(mocks: list[MockHardware]) -> bool:
    return [mock.state for mock in mocks] == [LifecycleState.UNCONFIGURED]


def test_ctrl_c_during_the_shutdown_does_not_close_the_ports_before_its_end(
    arm: Arm, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On Python 3.11 and 3.12, Ctrl-C during ``Thread.join`` makes ``Thread.is_alive`` return False."""
    closed, early = threading.Event(), []
    cleanup, end = MockHardware.cleanup, ControlStack.end

    def closes(mock: MockHardware) -> None:
        closed.set()
        cleanup(mock)

    def ends(stack: ControlStack, hurry: Hurry) -> list[str]:
        main = threading.main_thread().ident
        assert main is not None
        signal.pthread_kill(main, signal.SIGINT)
        while not hurry():  # The main thread has not handled Ctrl-C yet.
            closed.wait(0.001)
        early.append(closed.wait(0.3))
        return end(stack, hurry)

    monkeypatch.setattr(MockHardware, "cleanup", closes)
    monkeypatch.setattr(ControlStack, "end", ends)
    arm.close()
    assert early == [False] and closed.is_set()


def test_ctrl_c_while_the_loop_starts_shuts_the_arm_down(
    mocks: list[MockHardware], monkeypatch: pytest.MonkeyPatch
) -> None:
    start, end = LoopThread.start, ControlStack.end
    ends: list[LifecycleState] = []

    def started(run: LoopThread) -> threading.Thread:
        start(run)
        raise KeyboardInterrupt

    def ending(stack: ControlStack, hurry: Hurry) -> list[str]:
        ends.append(mocks[0].state)
        return end(stack, hurry)

    monkeypatch.setattr(LoopThread, "start", started)
    monkeypatch.setattr(ControlStack, "end", ending)
    with pytest.raises(KeyboardInterrupt):
        Arm("so101")
    assert ends == [LifecycleState.ACTIVE] and ended(mocks)
