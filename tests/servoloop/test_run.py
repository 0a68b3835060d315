"""The arm is stopped and the main thread is notified, however the thread of the control loop ends."""

import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from drivers.driver_errors import PortLost
from servoloop.stack.background_worker import BackgroundWorker
from servoloop.stack.control_stack import ControlStack
from servoloop.stack.hardware import HardwareSetup
from servoloop.stack.loop_thread import HANG_S, LoopThread
from servoloop.stack.robot_files import read_files
from servoloop.stack.signals import Signals
from tests.controller.bench import Bench
from tests.ros.two_components import write_urdf


def run_of(folder: Path) -> tuple[Bench, LoopThread]:
    """Run three cycles, then send the signal."""
    bench, signals = Bench().up(), Signals()
    files = read_files(write_urdf(folder))
    setup = HardwareSetup(bench.loop.hardware, dict, {}, True, {}, {}, {})
    run = LoopThread(ControlStack(setup, files, bench.loop, BackgroundWorker()), signals, wall=bench.clock)
    bench.loop.on_cycle = lambda state: signals.ask() if len(bench.hardware.written) > 2 else None
    return bench, run


def test_a_signal_is_not_a_failure(tmp_path: Path) -> None:
    bench, run = run_of(tmp_path)
    run()
    assert (run.done, run.failed) == (True, False)
    assert bench.hardware.calls[-2:] == ["hold", "cleanup"]


@pytest.mark.parametrize("kind", [PortLost, RuntimeError])
def test_an_error_that_ends_the_loop_is_a_failure_and_the_arm_is_stopped(tmp_path: Path, kind: type[Exception]) -> None:
    bench, run = run_of(tmp_path)
    bench.hardware.failing["read"] = kind("the line is broken")
    run()
    assert (run.done, run.failed) == (True, True)
    assert bench.hardware.calls[-2:] == ["hold", "cleanup"]


def test_a_plugin_that_exits_ends_the_loop_as_a_failure(tmp_path: Path) -> None:
    bench, run = run_of(tmp_path)
    bench.hardware.failing["read"] = SystemExit(0)  # type: ignore[assignment]
    with pytest.raises(SystemExit):
        run()
    assert (run.done, run.failed) == (True, True)


def test_a_failure_during_shutdown_is_reported(tmp_path: Path) -> None:
    bench, run = run_of(tmp_path)
    bench.hardware.failing["hold"] = RuntimeError("a defect")
    run()
    assert (run.done, run.failed) == (True, True)


def test_a_loop_that_is_delayed_between_two_cycles_still_ends_on_request(tmp_path: Path) -> None:
    bench, run = run_of(tmp_path)
    held: list[bool] = []

    def hold(ended: Callable[[], bool]) -> None:
        held.append(ended())
        if len(bench.hardware.written) == 2:
            run.signals.ask()
            held.append(ended())

    run.before_cycle = hold
    run()
    assert (run.done, run.failed) == (True, False)
    assert held == [False, False, False, True]


def test_the_end_waits_for_background_work() -> None:
    done: list[int] = []
    worker = BackgroundWorker()
    for number in range(3):
        worker(lambda number=number: done.append(number))  # type: ignore[misc]
    worker.join()
    assert sorted(done) == [0, 1, 2]


def test_the_end_does_not_wait_forever_for_background_work() -> None:
    worker, blocked = BackgroundWorker(join_s=0.01), threading.Event()
    worker(blocked.wait)
    with pytest.raises(TimeoutError, match="a hardware change is still running after 0 s"):
        worker.join()
    blocked.set()
    for thread in threading.enumerate():
        if thread.name == "hardware change":
            thread.join(10.0)
    worker.join()


def test_a_loop_without_progress_counts_as_hanging(tmp_path: Path) -> None:
    bench, run = run_of(tmp_path)
    later = bench.clock.now() + HANG_S
    run.alive_s = bench.clock.now()
    bench.clock.sleep_until(later + 1.0)
    assert not run.hangs()  # no signal has requested the end yet
    run.signals.ask()
    bench.clock.sleep_until(later + HANG_S)
    assert not run.hangs()
    bench.clock.sleep_until(later + HANG_S + 2.0)
    assert run.hangs()
    run()
    assert not run.hangs()
