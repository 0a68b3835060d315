"""The benches run, every client of theirs reads the servos, and what they print is complete. No times are judged."""

import io
import os
import subprocess
import sys
from pathlib import Path

import pytest
from rich.console import Console

from bench.bus import CLIENTS, compare, show, wire_us


@pytest.mark.parametrize("make", CLIENTS)
@pytest.mark.parametrize("options", [(), ("--paced", "1000000")], ids=["unpaced", "paced"])
def test_every_client_reads_every_servo(make: str, options: tuple[str, ...]) -> None:
    found = compare(make, 3, 20, 1, *options)
    makers = f"{make}-sdk".replace("feetech", "feetech-servo")
    assert set(found) == set(CLIENTS[make]) >= {"system calls alone", "servoloop", "rustypot", makers}
    # A busy machine can make a client miss a reply; one that reads nothing fails in all twenty cycles.
    assert all(failed <= 10 for _, _, failed in found.values()), found
    text = io.StringIO()
    show(Console(file=text, width=120), make, found, wire_us(make, 3))
    assert all(name in text.getvalue() for name in found)


def test_a_cycle_of_seven_servos_on_the_wire() -> None:
    # Goals 8 + 7 * 8 bytes, question 8 + 7, seven replies of 14: 177 bytes of ten bits.
    assert wire_us("feetech", 7) == pytest.approx(1770.0)
    # Goals 14 + 7 * 9, question 14 + 7, seven replies of 34 (23 of them data): 336 bytes.
    assert wire_us("dynamixel", 7) == pytest.approx(3360.0)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("bench.two_ports", "--cycles", "50"), ("overlapped", "one after the other")),
        (("bench.decoder", "--bytes", "100000"), ("Feetech and protocol 1.0: 100000", "\nprotocol 2.0: 100000")),
    ],
    ids=lambda a: a[0] if isinstance(a, tuple) else "",
)
def test_the_other_benches_print_their_figures(arguments: tuple[str, ...], words: tuple[str, ...]) -> None:
    done = subprocess.run([sys.executable, "-m", *arguments], capture_output=True, text=True, timeout=100)
    assert "Traceback" not in done.stderr, done.stderr
    assert all(word in done.stdout for word in words), done.stdout


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("bench.simulator new --ids 5-3", "--ids takes IDs from 0 to 253, such as 1-7 or 1,2,5, not '5-3'"),
        ("bench.simulator new --ids 1,1", "--ids takes different IDs, not '1,1'"),
        ("bench.simulator new --make sts3215", "argument --make: invalid choice: 'sts3215'"),
        ("bench.simulator new --paced -5", "argument --paced: '-5' is no whole number from 1 on"),
        ("bench.simulator new --silence 3", "argument --silence: '3' is no ID with two times"),
        ("bench.simulator taken", "argument link: taken exists and is no link: choose another path"),
        ("bench.two_ports --serve taken", "argument --serve: taken exists and is no link: choose another path"),
        ("bench.simulator no/where", "no/where cannot be made: No such file or directory"),
        ("bench.bus --make sts3215", "argument --make: invalid choice: 'sts3215'"),
        ("bench.bus --cycles -1", "argument --cycles: '-1' is no whole number from 1 on"),
        ("bench.bus --rounds 0", "argument --rounds: '0' is no whole number from 1 on"),
        ("bench.bus --servos 0", "argument --servos: '0' is no whole number from 1 on"),
        ("bench.bus --servos 32", "--servos takes at most 31 of feetech, not 32"),
        ("bench.two_ports --cycles 0", "argument --cycles: '0' is no whole number from 1 on"),
        ("bench.two_ports --cycles many", "argument --cycles: 'many' is no whole number from 1 on"),
        ("bench.decoder --bytes -1", "argument --bytes: '-1' is no whole number from 1 on"),
    ],
)
def test_what_a_bench_cannot_take_is_said_in_a_sentence(arguments: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("mine")
    root = Path(__file__).parents[2]
    done = subprocess.run(
        [sys.executable, "-m", *arguments.split()],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(root)},
        timeout=20,
    )
    assert done.returncode == 2, done.stderr
    assert done.stderr.splitlines()[-1].partition(": error: ")[2].startswith(words)
    assert not done.stdout
    assert (tmp_path / "taken").read_text() == "mine"
