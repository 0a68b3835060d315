"""Tests that the benchmarks run, that all their clients read the servos, and that their output is complete.

Times are not checked.
"""

import importlib
import io
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from benchmarks.bus import BAUDS, CLIENTS, compare, show
from benchmarks.processes.busy import without_priority
from benchmarks.stalls import JointSteps

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("make", "baud"), [(make, baud) for make, bauds in BAUDS.items() for baud in (None, *bauds)], ids=str
)
def test_every_client_reads_every_servo(make: str, baud: int | None) -> None:
    found = compare(make, 3, 20, 1, baud)
    makers = f"{make}-sdk".replace("feetech", "feetech-servo")
    assert set(found) == set(CLIENTS[make]) >= {"system calls alone", "servoloop", "rustypot", makers}
    # On a busy machine, a client may miss a reply. A client that does not work fails in all twenty cycles.
    assert all(failed <= 10 for _, _, failed in found.values()), found
    text = io.StringIO()
    wire_us = {name: driver.wire_us(3, baud) for name, driver in CLIENTS[make].items()} if baud else {}
    show(Console(file=text, width=120), make, found, wire_us)
    assert all(name in text.getvalue() for name in found)


def test_a_cycle_of_seven_servos_on_the_wire() -> None:
    # Goals 8 + 7 * 8 bytes, request 8 + 7 bytes, seven replies of 14 bytes: 177 bytes of ten bits.
    assert CLIENTS["feetech"]["servoloop"].wire_us(7, 1_000_000) == pytest.approx(1770.0)
    # Goals 14 + 7 * 9 bytes, request 14 + 7 bytes, seven replies of 34 bytes (23 of them data): 336 bytes.
    makers = CLIENTS["dynamixel"]
    assert makers["rustypot"].wire_us(7, 1_000_000) == pytest.approx(3360.0)
    # One reply of 8 bytes and seven times 27 for all servos; with 18 instead of 23 bytes of state, seven times 22.
    assert makers["dynamixel-sdk, fast sync read"].wire_us(7, 1_000_000) == pytest.approx(2950.0)
    assert makers["servoloop"].wire_us(7, 4_000_000) == pytest.approx(650.0)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ("benchmarks.rates", "--cycles", "50", "--seconds", "2", "--rates", "20", "100"),
            ("20 Hz", "100 Hz", "servoloop up", "loop alone", "system calls alone"),
        ),
        (("benchmarks.two_ports", "--cycles", "50"), ("overlapped", "one after the other")),
        (("benchmarks.decoder", "--bytes", "100000"), ("Feetech and protocol 1.0: 100000", "\nprotocol 2.0: 100000")),
        (("benchmarks.recording", "--seconds", "1"), ("in the loop thread", "% of a core")),
        (("benchmarks.command_socket", "--messages", "50"), ("set_point", "median, ms")),
        (("benchmarks.stream", "--seconds", "2"), ("call to bytes", "100 targets; ", " 0 lost")),
        (
            ("benchmarks.several_stacks", "--stacks", "2", "--seconds", "1"),
            ("2 stacks at 20 Hz", "of a core on average"),
        ),
        (
            ("benchmarks.topic_host", "--seconds", "2", "--rate", "50"),
            ("bytes to state topic", "100 commands; ", " 0 lost"),
        ),
    ],
    ids=lambda a: a[0] if isinstance(a, tuple) else "",
)
def test_the_other_benchmarks_print_their_figures(arguments: tuple[str, ...], words: tuple[str, ...]) -> None:
    done = subprocess.run([sys.executable, "-m", *arguments], capture_output=True, text=True, timeout=100)
    assert "Traceback" not in done.stderr and "torque" not in done.stderr, done.stderr
    assert all(word in done.stdout for word in words), done.stdout


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("benchmarks.simulator new --ids 5-3", "--ids must be IDs from 0 to 253, such as 1-7 or 1,2,5, not '5-3'"),
        ("benchmarks.simulator new --ids 1,1", "--ids must list each ID only once, not '1,1'"),
        ("benchmarks.simulator new --make sts3215", "argument --make: invalid choice: 'sts3215'"),
        ("benchmarks.simulator new --paced -5", "argument --paced: must be a whole number of at least 1, not '-5'"),
        ("benchmarks.simulator new --silence 3", "argument --silence: must be a servo ID and two times"),
        ("benchmarks.simulator taken", "argument link: taken exists and is not a symbolic link: choose another path"),
        (
            "benchmarks.two_ports --serve taken",
            "argument --serve: taken exists and is not a symbolic link: choose another path",
        ),
        ("benchmarks.simulator no/where", "no/where cannot be created: No such file or directory"),
        ("benchmarks.bus --make sts3215", "argument --make: invalid choice: 'sts3215'"),
        ("benchmarks.bus --cycles -1", "argument --cycles: must be a whole number of at least 1, not '-1'"),
        ("benchmarks.bus --rounds 0", "argument --rounds: must be a whole number of at least 1, not '0'"),
        ("benchmarks.bus --servos 0", "argument --servos: must be a whole number of at least 1, not '0'"),
        ("benchmarks.bus --baud 0", "argument --baud: must be a whole number of at least 1, not '0'"),
        ("benchmarks.bus --servos 32", "--servos must be 1 to 31 for feetech, not 32"),
        ("benchmarks.two_ports --cycles 0", "argument --cycles: must be a whole number of at least 1, not '0'"),
        ("benchmarks.two_ports --cycles many", "argument --cycles: must be a whole number of at least 1, not 'many'"),
        ("benchmarks.stalls --jobs 0", "argument --jobs: must be a whole number of at least 1, not '0'"),
        ("benchmarks.stalls --busy many", "argument --busy: must be a whole number of at least 1, not 'many'"),
        ("benchmarks.decoder --bytes -1", "argument --bytes: must be a whole number of at least 1, not '-1'"),
    ],
)
def test_invalid_arguments_of_a_benchmark_are_reported_in_one_sentence(
    arguments: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "taken").write_text("mine")
    monkeypatch.chdir(tmp_path)
    bench, *options = arguments.split()
    monkeypatch.setattr(sys, "argv", [bench, *options])
    with pytest.raises(SystemExit) as exit_:
        importlib.import_module(bench).main()
    assert exit_.value.code == 2
    said = capsys.readouterr()
    assert said.err.splitlines()[-1].partition(": error: ")[2].startswith(words)
    assert not said.out
    assert (tmp_path / "taken").read_text() == "mine"


def test_a_program_without_the_right_to_real_time_priority_gets_none() -> None:
    program = "import os\ntry: os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))\nexcept OSError: print('none')"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, preexec_fn=without_priority)
    assert done.stdout == "none\n"


def test_the_largest_step_is_relative_to_the_velocity_limit() -> None:
    """At first, the joint moves at half its velocity limit.

    The feed then publishes 0.2 s late, and the average speed in that time is three quarters of the limit.
    """
    times_s = [0.01 * i for i in range(11)] + [0.3]
    slide = [0.5 * t for t in times_s[:11]] + [0.05 + 0.75 * 0.2]
    trace = [(t, [1.0, p]) for t, p in zip(times_s, slide, strict=True)]
    feed = Feed(
        [{"joints": {"a": 0.0, "b": 0.0}, "trace": trace[:6]}, {"joints": {"a": 0, "b": 0}, "trace": trace[6:]}]
    )
    steps = JointSteps(feed, {"a": 1.0, "b": 1.0})
    steps.look()
    steps.look()  # no new data has arrived
    assert steps.joint == "b"
    assert steps.largest == pytest.approx(0.75)


class Feed:
    """Feed that returns all publications at once."""

    def __init__(self, publications: list[dict[str, Any]]) -> None:
        self._publications = publications

    def all(self) -> list[dict[str, Any]]:
        publications, self._publications = self._publications, []
        return publications
