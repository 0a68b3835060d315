"""Compare our driver with the manufacturers' SDKs and rustypot on one bus, with and without transmission time.

``python -m benchmarks.bus [--make feetech|dynamixel] [--cycles 1000] [--rounds 5] [--servos 7]``.

The clients take turns in rounds, so that other load on the machine affects all of them. The table shows the median
round.
"""

import argparse
import gc
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.table import Table

from benchmarks import clients, dynamixel_clients
from benchmarks.arguments import in_words, positive
from benchmarks.children import child
from benchmarks.peers import Client
from drivers.servos.dynamixel import X
from drivers.servos.feetech import STS
from servoloop.stack.processes import on_one_processor

BAUD = 1_000_000
CLIENTS: Mapping[str, Mapping[str, Callable[[str, int, Sequence[int]], Client]]] = {
    "feetech": clients.CLIENTS,
    "dynamixel": dynamixel_clients.CLIENTS,
}
SERIES = {"feetech": STS, "dynamixel": X}
MOST_SERVOS = {"feetech": 31, "dynamixel": 100}
"""Maximum number of servos whose goals every client can send in one packet."""
WARM_UP = 50

Round = tuple[float, float, int]
"""Median wall time and CPU time of a cycle in microseconds, and number of cycles in which a servo was missing."""


@contextmanager
def simulator(ids: str, *options: str) -> Iterator[str]:
    """Run a simulated bus in its own process and yield the path of its line."""
    with tempfile.TemporaryDirectory(prefix="bench-") as folder:
        link = str(Path(folder) / "bus")
        with child("-m", "benchmarks.simulator", link, "--ids", ids, *options):
            yield link


def one_round(cycle: Callable[[], bool], cycles: int) -> Round:
    """Warm up, then run ``cycles`` cycles."""
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


def compare(make: str, servos: int, cycles: int, rounds: int, *options: str) -> dict[str, Round]:
    """Return the median round of every client on one simulated bus."""
    makers = CLIENTS[make]
    ids = list(range(1, servos + 1))
    found: dict[str, list[Round]] = {name: [] for name in makers}
    with simulator(f"1-{servos}", "--make", make, *options) as device:
        for _ in range(rounds):
            for name, maker in makers.items():
                cycle, close = maker(device, BAUD, ids)
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


def show(console: Console, title: str, found: dict[str, Round], on_wire_us: float | None) -> None:
    """Print one row per client. The last column compares its speed with rustypot or with the wire."""
    table = Table("client", "us a cycle", "CPU us", "cycles/s to rustypot's", "to the wire", "failed", title=title)
    theirs_us = found["rustypot"][0]
    for name, (cycle_us, cpu_us, failed) in found.items():
        to_wire = f"{cycle_us / on_wire_us:.3f}" if on_wire_us else "-"
        table.add_row(name, f"{cycle_us:.1f}", f"{cpu_us:.1f}", f"{theirs_us / cycle_us:.2f}", to_wire, str(failed))
    console.print(table)


def wire_us(make: str, servos: int) -> float:
    """Return the transmission time of one cycle with plain packets (goals, request, replies), in microseconds."""
    series = SERIES[make]
    block, packets = series.blocks[0], series.protocol.packets
    entry = bytes(1 + series.goal_size)
    goals = len(packets.sync_write(series.goal_address, series.goal_size, entry * servos))
    question = len(packets.sync_read(range(1, servos + 1), block.address, block.size))
    bits: float = 10.0 * (goals + question + (block.size + packets.OVERHEAD) * servos)
    return bits * 1e6 / BAUD


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--make", choices=tuple(CLIENTS), default="feetech")
    parser.add_argument("--cycles", type=positive, default=1000)
    parser.add_argument("--rounds", type=positive, default=5)
    parser.add_argument("--servos", type=positive, default=7)
    arguments = parser.parse_args()
    most = MOST_SERVOS[arguments.make]
    if arguments.servos > most:
        parser.error(f"--servos must be 1 to {most} for {arguments.make}, not {arguments.servos}")
    console = Console(width=110)
    sizes = arguments.make, arguments.servos, arguments.cycles, arguments.rounds
    show(console, "no wire time", compare(*sizes), None)
    on_wire_us = wire_us(arguments.make, arguments.servos)
    paced = compare(*sizes, "--paced", str(BAUD))
    show(console, f"paced at {BAUD} bit/s: transmission takes {on_wire_us:.0f} us", paced, on_wire_us)


if __name__ == "__main__":
    with in_words():
        main()
