"""Tests that a benchmark always ends, whatever its child processes do, and that no child outlives it."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil
import pytest

from benchmarks.processes.children import child, kill, next_line, start

pytestmark = pytest.mark.slow

PARENT = """
import sys
from benchmarks.processes.children import child
with child("-m", "benchmarks.simulator", sys.argv[1]) as simulator:
    print(simulator.pid, flush=True)
    sys.stdin.read()
"""


def test_unexpected_output_of_a_child_ends_the_benchmark_with_a_message() -> None:
    with (
        pytest.raises(SystemExit, match="-c print\\('no'\\)… is not ready: it printed 'no' instead of 'ready'"),
        child("-c", "print('no')"),
    ):
        pytest.fail("it is not ready")


def test_a_child_that_ends_at_once_ends_the_benchmark_with_a_message() -> None:
    with pytest.raises(SystemExit, match="it printed '' instead of 'ready'"), child("-c", "pass"):
        pytest.fail("it is not ready")


def test_a_child_that_hangs_ends_the_benchmark_with_a_message() -> None:
    process = start("-c", "import time; time.sleep(99)")
    with pytest.raises(SystemExit, match=f"process {process.pid} has not printed anything for 0 s"):
        next_line(process, patience_s=0.1)
    kill(process)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("bench", "simulator"),
    [("benchmarks.two_ports --cycles 100000", "--serve"), ("benchmarks.bus --cycles 100000", "benchmarks.simulator")],
)
def test_a_killed_simulator_ends_the_benchmark_with_a_message(bench: str, simulator: str) -> None:
    with measuring(*bench.split()) as process:
        next(one for one in psutil.Process(process.pid).children() if simulator in one.cmdline()).kill()
        _, words = process.communicate(timeout=60)
    assert process.returncode == 1
    assert words.splitlines()[-1].startswith("the benchmark ends: ")
    assert "Traceback" not in words


@contextmanager
def measuring(*command: str) -> Iterator["subprocess.Popen[str]"]:
    """Start a program, wait until it has opened a pseudo-terminal, and let it measure for a second."""
    with subprocess.Popen([sys.executable, "-m", *command], stderr=subprocess.PIPE, text=True) as process:
        try:
            deadline_s = time.monotonic() + 60.0
            while not any(line.startswith("/dev/pts/") for line in open_files(process.pid)):
                assert process.poll() is None and time.monotonic() < deadline_s
                time.sleep(0.05)
            time.sleep(1.0)
            yield process
        finally:
            process.kill()


def open_files(process_id: int) -> list[str]:
    """Return the open files except for the standard streams, which may be a terminal."""
    found = []
    for descriptor in Path(f"/proc/{process_id}/fd").iterdir():
        with suppress(FileNotFoundError):
            found += [os.readlink(descriptor)] if int(descriptor.name) > 2 else []
    return found


@pytest.mark.parametrize(
    ("number", "says"), [(signal.SIGKILL, "has disappeared"), (signal.SIGSTOP, "accepts no more bytes")]
)
def test_the_measurement_of_a_line_ends_when_its_servos_disappear(tmp_path: Path, number: int, says: str) -> None:
    with child("-m", "benchmarks.simulator", str(tmp_path / "bus")) as simulator:
        command = ["servoloop", "bench", "bus", "--port", str(tmp_path / "bus"), "--cycles", "10000000"]
        with measuring(*command) as process:
            simulator.send_signal(number)
            _, words = process.communicate(timeout=60)
    assert process.returncode == 1
    assert says in words and "Traceback" not in words


def test_a_simulator_ends_when_its_benchmark_is_killed(tmp_path: Path) -> None:
    command = [sys.executable, "-c", PARENT, str(tmp_path / "bus")]
    bench = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert bench.stdout is not None
    simulator = psutil.Process(int(bench.stdout.readline()))
    bench.kill()
    bench.communicate()
    gone, _ = psutil.wait_procs([simulator], timeout=20.0)
    assert gone == [simulator] or simulator.status() == psutil.STATUS_ZOMBIE
