"""The benches run, every client of theirs reads the servos, and what they print is complete. No times are judged."""

import io
import subprocess
import sys

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
        (("bench.decoder", "--bytes", "100000"), ("100",)),
    ],
    ids=lambda a: a[0] if isinstance(a, tuple) else "",
)
def test_the_other_benches_print_their_figures(arguments: tuple[str, ...], words: tuple[str, ...]) -> None:
    done = subprocess.run([sys.executable, "-m", *arguments], capture_output=True, text=True, timeout=100)
    assert "Traceback" not in done.stderr, done.stderr
    assert all(word in done.stdout for word in words), done.stdout
