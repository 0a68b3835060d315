"""Every command ends if a process for which it waits is killed or stopped, and after a second signal."""

import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest

from tests.ros.fake_arm import Plan
from tests.ros.hardware_plugin import Orders, install
from tests.ros.pick_place_cell import Cell
from tests.ros.stack_process import StackProcess, running, until
from tests.ros.two_components import add_states, write_urdf

pytestmark = pytest.mark.slow

AT_ONCE = (128 + signal.SIGINT, 128 + signal.SIGTERM)
"""Exit statuses after two simultaneous signals, either of which may be handled first."""

LEAVE_S = 5.0
"""Time in which a command ends on a busy machine, in seconds. On an idle machine, a command ends after one second, or
after ten if it has to wait."""


@pytest.fixture
def cell(ros_domain: int, tmp_path: Path) -> Iterator[Cell]:
    """Run a node whose arm moves until the goal is canceled."""
    with Cell(ros_domain, tmp_path / "node.log") as cell:
        cell.clear(Plan.HOLD)
        yield cell


@pytest.fixture
def pick(cell: Cell, tmp_path: Path) -> Iterator[StackProcess]:
    """Run ``servoloop pick`` until the middle of its job."""
    pick = StackProcess(tmp_path / "pick.log", "pick", "A")
    until(lambda: "ready: " in pick.words, lambda: pick.process.poll() is not None and pick.words)
    yield pick
    pick.process.kill()
    pick.process.wait()


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_pick_ends_when_its_node_is_killed(cell: Cell, pick: StackProcess, number: int) -> None:
    """The middleware considers a silent participant alive for up to 20 s."""
    cell.process.send_signal(number)
    begin_s = time.monotonic()
    assert pick.process.wait(60.0) == 1
    assert time.monotonic() - begin_s < 5.0
    text = "failed: /sorting/arm/pick_place disappeared: the node has exited. Check its log. The arm finishes"
    assert text in pick.words


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_cancels_the_job_of_pick(cell: Cell, pick: StackProcess, number: int) -> None:
    assert pick.end(number) == 1
    assert "failed: canceled" in pick.words
    assert cell.below().canceled == 1


def test_first_signal_ends_pick_without_a_wait_after_its_node_is_killed(cell: Cell, pick: StackProcess) -> None:
    cell.process.send_signal(signal.SIGKILL)
    time.sleep(1.0)
    begin_s = time.monotonic()
    assert pick.end(signal.SIGTERM) == 1
    assert time.monotonic() - begin_s < LEAVE_S
    assert "failed: canceled, but /sorting/arm/pick_place does not respond. The arm finishes" in pick.words


def test_two_signals_end_pick(cell: Cell, pick: StackProcess) -> None:
    cell.process.send_signal(signal.SIGSTOP)
    pick.process.send_signal(signal.SIGINT)
    pick.process.send_signal(signal.SIGTERM)
    assert pick.process.wait(8.0) in (1, *AT_ONCE)  # less than the ten seconds of the confirmation


def test_signal_before_the_job_of_pick_prevents_it(ros_domain: int, tmp_path: Path) -> None:
    """No node provides the action, so the command waits for a server."""
    pick = StackProcess(tmp_path / "pick.log", "pick", "A")
    until(lambda: handles(pick.process.pid, signal.SIGTERM), lambda: pick.process.poll() is not None and pick.words)
    assert pick.end(signal.SIGTERM) == 130
    assert pick.words.endswith("servoloop: interrupted before the job began\n")


def handles(process_id: int, number: int) -> bool:
    """Return whether the process handles the signal."""
    status = Path(f"/proc/{process_id}/status").read_text()
    caught = next(line for line in status.splitlines() if line.startswith("SigCgt:"))
    return bool(int(caught.split()[1], 16) >> (number - 1) & 1)


def emulator_of(stack: StackProcess) -> int:
    """Return the process ID of the emulator of a stack on virtual servos."""
    (emulator,) = [c for c in psutil.Process(stack.process.pid).children() if "emulate" in c.cmdline()]
    return int(emulator.pid)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_stack_ends_when_its_servos_are_gone(ros_domain: int, tmp_path: Path, number: int) -> None:
    with running(tmp_path) as stack:
        emulator = emulator_of(stack)
        os.kill(emulator, number)
        words = ("does not respond", "no servo responds", "has disappeared")
        until(lambda: any(word in stack.words for word in words))
        assert stack.end(signal.SIGTERM) in (0, 1), stack.words
        assert "Traceback" not in stack.words
    assert not psutil.pid_exists(emulator)


@pytest.fixture
def hanging(ros_domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[StackProcess]:
    """Run a stack whose arm is a user plugin that hangs in ``read``."""
    monkeypatch.setenv("PYTHONPATH", install(tmp_path))
    orders = Orders(tmp_path / "orders")
    urdf = add_states(write_urdf(tmp_path, arm=orders.hardware), "joint1", "reads", "writes")
    with running(tmp_path, "--urdf", str(urdf)) as stack:
        orders.give("read", 600.0)
        until(lambda: not (orders.folder / "read").exists())
        yield stack


def test_second_signal_ends_a_stack_with_hanging_hardware(hanging: StackProcess) -> None:
    hanging.process.send_signal(signal.SIGINT)
    hanging.process.send_signal(signal.SIGTERM)
    assert hanging.process.wait(20.0) in AT_ONCE
    assert "ended at once by a second signal: servos with torque enabled hold their last goal" in hanging.words


def test_one_signal_ends_a_stack_with_hanging_hardware(hanging: StackProcess) -> None:
    assert hanging.end(signal.SIGINT) == 1
    assert (
        "the control loop is blocked by its hardware and could not be stopped: servos with torque enabled hold"
        in hanging.words
    )


@contextmanager
def demo(folder: Path) -> Iterator[StackProcess]:
    demo = StackProcess(folder / "demo.log", "demo", "--grades", "A", "--out", str(folder / "out"))
    try:
        yield demo
    finally:
        children = psutil.Process(demo.process.pid).children() if demo.process.poll() is None else []
        demo.process.kill()
        demo.process.wait()
        psutil.wait_procs(children, timeout=30.0)


def child(demo: StackProcess, word: str) -> psutil.Process:
    (found,) = [c for c in psutil.Process(demo.process.pid).children() if word in " ".join(c.cmdline())]
    return found


WORDS = {"servoloop emulate": "emulator", "servoloop up": "stack", "vision_pick_place": "pick_place"}


@pytest.mark.parametrize("word", WORDS)
def test_demo_ends_and_names_a_killed_process(ros_domain: int, tmp_path: Path, word: str) -> None:
    with demo(tmp_path) as process:
        until(lambda: "grade A: ready" in process.words, lambda: process.process.poll() is not None and process.words)
        others = psutil.Process(process.process.pid).children()
        child(process, word).kill()
        assert process.process.wait(90.0) == 1
        assert "servoloop: " + WORDS[word] + " ended unexpectedly (exit status -9)" in process.words
        assert "Traceback" not in process.words
        assert not any(other.is_running() for other in others)


@pytest.mark.parametrize("when", ["the stack", "the pick-and-place node", "grade A: ready"])
def test_the_demo_ends_at_a_signal_at_any_time(ros_domain: int, tmp_path: Path, when: str) -> None:
    with demo(tmp_path) as process:
        until(lambda: when in process.words, lambda: process.process.poll() is not None and process.words)
        others = psutil.Process(process.process.pid).children()
        assert process.end(signal.SIGINT) == 130
        assert "servoloop: interrupted" in process.words
        assert not any(other.is_running() for other in others)


def test_second_signal_ends_the_demo_and_its_processes(ros_domain: int, tmp_path: Path) -> None:
    with demo(tmp_path) as process:
        until(lambda: "the pick-and-place node" in process.words)
        others = psutil.Process(process.process.pid).children()
        stopped = child(process, "servoloop up")
        stopped.suspend()
        for number in (signal.SIGINT, signal.SIGTERM):
            process.process.send_signal(number)
        assert process.process.wait(30.0) in AT_ONCE
        psutil.wait_procs(others, timeout=30.0)
        assert not any(other.is_running() for other in others)


def test_second_signal_ends_a_node_whose_arm_does_not_stop(cell: Cell) -> None:
    cell.clear(Plan.REFUSE_CANCEL)
    cell.pick("A")
    cell.wait_for_goals(1)
    for number in (signal.SIGINT, signal.SIGTERM):
        cell.process.send_signal(number)
    assert cell.process.wait(20.0) in AT_ONCE
    assert "second signal: ended at once. The arm finishes its current motion and holds its position" in cell.log()
