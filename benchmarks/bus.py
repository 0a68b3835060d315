"""Compare our driver with the manufacturers' SDKs and rustypot on one bus, with and without transmission delays.

``python -m benchmarks.bus [--make feetech|dynamixel] [--cycles 1000] [--rounds 5] [--servos 7] [--baud 1000000 ...]``.

The clients take turns in rounds, so that other load on the machine affects all of them equally. The table shows the
medians over all rounds for each client. The last table shows how a silent servo affects the other servos
(``silent_servo``).
"""

import argparse
import gc
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.table import Table

from benchmarks.clients import dynamixel, feetech
from benchmarks.clients.peers import Driver
from benchmarks.processes.children import child
from benchmarks.shared.arguments import in_words, positive
from benchmarks.silent_servo import show_silent
from servoloop.stack.processes import on_one_processor

BAUDS = {"feetech": (1_000_000,), "dynamixel": (1_000_000, 3_000_000, 4_000_000)}
"""Default baud rates for the tables that include transmission time."""
CLIENTS: Mapping[str, Mapping[str, Driver]] = {
    "feetech": feetech.CLIENTS,
    "dynamixel": dynamixel.CLIENTS,
}
MOST_SERVOS = {"feetech": 31, "dynamixel": 100}
"""Maximum number of servos to which every client can send goals in one packet."""
WARM_UP = 50

Round = tuple[float, float, int]
"""Median wall time and CPU time of a cycle in microseconds, and the number of cycles in which a servo was missing."""


@contextmanager
def simulator(ids: str, *options: str) -> Iterator[str]:
    """Run a simulated bus in a separate process and yield the path of its serial port."""
    with tempfile.TemporaryDirectory(prefix="bench-") as folder:
        link = str(Path(folder) / "bus")
        with child("-m", "benchmarks.simulator", link, "--ids", ids, *options):
            yield link


def one_round(cycle: Callable[[], bool], cycles: int) -> Round:
    """Warm up, and then measure ``cycles`` cycles."""
    for _ in range(WARM_UP):
        cycle()
    gc.collect()
    gc.freeze()
    took_s = []
    failed = 0
    cpu_s, last_s = time.process_time(), time.perf_counter()
    for _ in range(cycles):
        failed += not cycle()
        now_s = time.perf_counter()
        took_s.append(now_s - last_s)
        last_s = now_s
    cpu_s = time.process_time() - cpu_s
    gc.unfreeze()
    return statistics.median(took_s) * 1e6, cpu_s / cycles * 1e6, failed


def compare(make: str, servos: int, cycles: int, rounds: int, baud: int | None = None) -> dict[str, Round]:
    """Return the median round of every client on one simulated bus.

    The simulator delays bytes by their transmission time at this baud rate. If ``baud`` is None, transmission time is
    not simulated.
    """
    ids = list(range(1, servos + 1))
    found: dict[str, list[Round]] = {name: [] for name in CLIENTS[make]}
    paced = ("--paced", str(baud)) if baud else ()
    with simulator(f"1-{servos}", "--make", make, *paced) as device:
        for _ in range(rounds):
            for name, driver in CLIENTS[make].items():
                cycle, close = driver.open(device, baud or BAUDS[make][0], ids)
                try:
                    with on_one_processor():
                        found[name].append(one_round(cycle, cycles))
                finally:
                    close()
    return {name: _middle(rounds_of) for name, rounds_of in found.items()}


def _middle(rounds: list[Round]) -> Round:
    return (
        statistics.median(cycle_us for cycle_us, _, _ in rounds),
        statistics.median(cpu_us for _, cpu_us, _ in rounds),
        sum(failed for _, _, failed in rounds),
    )


def show(console: Console, title: str, found: dict[str, Round], on_wire_us: Mapping[str, float]) -> None:
    """Print one row per client. The last columns compare the speed of each client with that of rustypot and with the
    transmission time.

    Args:
        console: Output.
        title: Title of the table.
        found: Result of each client's median round.
        on_wire_us: Transmission time of each client's cycle, in microseconds; empty if transmission time is not
            simulated.
    """
    columns = "client", "us/cycle", "CPU us", "cycles/s vs. rustypot's", "us on the wire", "to the wire", "failed"
    table = Table(*columns, title=title)
    theirs_us = found["rustypot"][0]
    for name, (cycle_us, cpu_us, failed) in found.items():
        wire_us = on_wire_us.get(name)
        wire = (f"{wire_us:.0f}", f"{cycle_us / wire_us:.3f}") if wire_us else ("-", "-")
        table.add_row(name, f"{cycle_us:.1f}", f"{cpu_us:.1f}", f"{theirs_us / cycle_us:.2f}", *wire, str(failed))
    console.print(table)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--make", choices=tuple(CLIENTS), default="feetech")
    parser.add_argument("--cycles", type=positive, default=1000)
    parser.add_argument("--rounds", type=positive, default=5)
    parser.add_argument("--servos", type=positive, default=7)
    parser.add_argument("--baud", type=positive, nargs="+", help="baud rates for the paced measurements, in bit/s")
    arguments = parser.parse_args()
    most = MOST_SERVOS[arguments.make]
    if arguments.servos > most:
        parser.error(f"--servos must be 1 to {most} for {arguments.make}, not {arguments.servos}")
    console, servos = Console(width=110), arguments.servos
    sizes = arguments.make, servos, arguments.cycles, arguments.rounds
    show(console, "no wire time", compare(*sizes), {})
    for baud in arguments.baud or BAUDS[arguments.make]:
        on_wire_us = {name: driver.wire_us(servos, baud) for name, driver in CLIENTS[arguments.make].items()}
        show(console, f"paced at {baud} bit/s", compare(*sizes, baud), on_wire_us)
    show_silent(console, servos)


if __name__ == "__main__":
    with in_words():
        main()
