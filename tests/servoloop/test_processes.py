"""Child processes always end, whatever they and their parent do."""

import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import psutil
import pytest

from drivers.driver_errors import DriverError
from servoloop.stack.processes import Interrupted, Processes, end, start_child

STUBBORN = "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('up', flush=True); time.sleep(99)"
PARENT = """
import sys, time
from servoloop.stack.processes import start_child
child = start_child([sys.executable, '-c', 'import time; time.sleep(99)'])
print(child.pid, flush=True)
time.sleep(99)
"""


def child(source: str) -> "subprocess.Popen[str]":
    """Start a child process and wait for its first line of output."""
    process = subprocess.Popen([sys.executable, "-c", source], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None and process.stdout.readline()
    return process


def test_a_stopped_process_is_ended() -> None:
    process = child("import time; print('up', flush=True); time.sleep(99)")
    process.send_signal(signal.SIGSTOP)
    assert end(process) == -signal.SIGTERM


def test_a_process_that_does_not_end_in_time_is_killed(caplog: pytest.LogCaptureFixture) -> None:
    process = child(STUBBORN)
    assert end(process, 0.1) == -signal.SIGKILL
    assert caplog.messages == [f"process {process.pid} did not end and was killed"]


def test_a_process_that_does_not_end_is_killed_at_once_on_request() -> None:
    assert end(child(STUBBORN), hurry=lambda: True) == -signal.SIGKILL


def test_a_process_that_has_already_ended_is_accepted() -> None:
    process = child("print('up', flush=True)")
    process.wait(10.0)
    assert end(process) == 0


def test_a_child_ends_when_its_parent_is_killed() -> None:
    with subprocess.Popen([sys.executable, "-c", PARENT], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        orphan = psutil.Process(int(parent.stdout.readline()))
        parent.kill()
    gone, _ = psutil.wait_procs([orphan], timeout=10.0)
    assert gone == [orphan] or orphan.status() == psutil.STATUS_ZOMBIE


def test_a_child_continues_after_the_thread_that_started_it() -> None:
    echo = [sys.executable, "-c", "print(input())"]
    with ThreadPoolExecutor() as threads:
        child = threads.submit(start_child, echo, stdin=subprocess.PIPE, stdout=subprocess.PIPE).result()
        thread = threads.submit(threading.get_native_id).result()
    while Path(f"/proc/self/task/{thread}").exists():  # Python reports the end of a thread a little earlier.
        time.sleep(0.001)
    assert child.communicate(b"here\n", timeout=60.0) == (b"here\n", None)


def test_a_command_that_cannot_be_started_is_reported() -> None:
    with pytest.raises(FileNotFoundError, match="no-such-command"):
        start_child(["no-such-command"])


def test_waiting_for_processes_ends_with_the_condition_a_signal_the_time_or_a_process(tmp_path: Path) -> None:
    signals = [0]
    with Processes(tmp_path, os.environ, lambda: signals[0]) as processes:
        processes.wait_until(lambda: True, "nothing", 0.0)
        with pytest.raises(DriverError, match=f"waiting took longer than 0 s: see the logs in {tmp_path}"):
            processes.wait_until(lambda: False, "waiting", 0.0)
        processes.start("calendar", "calendar", "--no-such-option")
        with pytest.raises(
            DriverError, match=r"calendar ended unexpectedly \(exit status 2\):(\n.*)*unrecognized arguments"
        ):
            processes.wait_until(lambda: False, "waiting", 30.0)
        signals[0] = 1
    with Processes(tmp_path, os.environ, lambda: signals[0]) as processes, pytest.raises(Interrupted, match="waiting"):
        processes.wait_until(lambda: False, "waiting", 30.0)


def test_processes_are_ended_in_reverse_order(tmp_path: Path) -> None:
    with Processes(tmp_path, os.environ) as processes:
        ids = [processes.start(name, "http.server", "0", "--bind", "127.0.0.1") for name in ("one", "two")]
        time.sleep(0.1)  # the process must end whether or not it has begun to serve
        assert list(processes.end()) == ["two", "one"]
    assert not any(psutil.pid_exists(process_id) for process_id in ids)


COLLECTIONS = """
import gc, sys
from servoloop.stack.processes import prompt_interpreter
before, generations = gc.get_threshold(), set()
with prompt_interpreter(sys.argv[1] == "True"):
    gc.callbacks.append(lambda phase, info: generations.add(info["generation"]))
    kept = [[] for _ in range(200_000)]
    gc.callbacks.clear()
print(*sorted(generations), gc.get_threshold() == before, gc.get_freeze_count())
"""


@pytest.mark.parametrize(("full", "generations"), [(False, "0 1"), (True, "0 1 2")])
def test_full_collections_delay_the_loop_only_if_they_are_requested(full: bool, generations: str) -> None:
    done = subprocess.run([sys.executable, "-c", COLLECTIONS, str(full)], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == f"{generations} True 0"
