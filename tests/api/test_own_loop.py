"""A loop that a script runs itself shuts the arm down completely, even after a signal. The loop runs in real time, with
mock joints."""

import signal
import threading
from collections.abc import Callable, Iterator

import pytest

from hal.lifecycle import LifecycleState
from hal.mock_hardware import MockHardware
from servoloop import Arm, ArmEndedError
from servoloop.api import thread_loop
from servoloop.api.own_loop import OwnLoop
from servoloop.api.pace import ThreadPace
from servoloop.api.thread_loop import ThreadLoop
from servoloop.stack import hardware
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.control_stack import ControlStack
from servoloop.stack.hardware import HardwareKind
from servoloop.stack.loop_thread import LoopThread
from servoloop.stack.processes import realtime_priority
from tests.api.contract import PAN

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


def interrupted_once(call: Callable[..., object], after: bool = False) -> Callable[..., object]:
    """Return a function that SIGTERM interrupts at its first call, before or after ``call``."""
    interrupts = [SystemExit(143)]

    def interrupted(*arguments: object) -> object:
        if interrupts:
            if after:
                call(*arguments)
            raise interrupts.pop()
        return call(*arguments)

    return interrupted


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


@pytest.mark.parametrize("where", ["before the start", "before the thread", "after the start"])
def test_ctrl_c_while_the_loop_starts_shuts_the_arm_down(
    mocks: list[MockHardware], monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    start, end = LoopThread.start, ControlStack.end
    ends: list[LifecycleState] = []

    def ending(stack: ControlStack, hurry: Hurry) -> list[str]:
        ends.append(mocks[0].state)
        return end(stack, hurry)

    if where == "before the start":
        monkeypatch.setattr(thread_loop, "realtime_priority", interrupted_once(realtime_priority))
    else:
        monkeypatch.setattr(LoopThread, "start", interrupted_once(start, after=where == "after the start"))
    monkeypatch.setattr(ControlStack, "end", ending)
    with pytest.raises(SystemExit):
        Arm("so101")
    assert ends == [LifecycleState.ACTIVE] and ended(mocks)


def test_sigterm_while_the_torque_is_enabled_can_shut_the_arm_down(
    mocks: list[MockHardware], monkeypatch: pytest.MonkeyPatch
) -> None:
    activate, handlers = MockHardware.activate, list[object]()

    def activated(mock: MockHardware) -> None:
        handlers.append(signal.getsignal(signal.SIGTERM))
        activate(mock)

    monkeypatch.setattr(MockHardware, "activate", activated)
    Arm("so101").close()
    assert (
        len(handlers) == 1 and handlers[0] is not signal.SIG_DFL and signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    )


def test_sigterm_at_the_start_of_the_shutdown_does_not_leave_the_arm_moving(
    arm: Arm, mocks: list[MockHardware], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ThreadPace, "close", interrupted_once(ThreadPace.close))
    motion = arm.move_to({PAN: 1.0}, duration=30.0, wait=False)
    arm.close()
    assert motion.done and ended(mocks)
    with pytest.raises(ArmEndedError, match="has been shut down"):
        arm.move_to({PAN: 0.0})


def test_a_shutdown_that_was_interrupted_goes_on_at_the_next_call(
    arm: Arm, mocks: list[MockHardware], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ThreadLoop, "ended", interrupted_once(ThreadLoop.ended))
    with pytest.raises(SystemExit):
        arm.close()
    arm.close()
    assert ended(mocks)
