"""Ours against the servo makers' SDKs and rustypot: one bus, one run, without and with the wire's own time.

``python -m benchmarks.bus [--make feetech|dynamixel] [--cycles 1000] [--rounds 5] [--servos 7]``. The clients take
turns, round by round, so that whatever else the machine does hits all of them; the median round is shown. The last
table shows what a silent servo costs the others (``silent_servo``).
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
from benchmarks.silent_servo import show_silent
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
"""Every client can send their goals in one packet."""
WARM_UP = 50

Round = tuple[float, float, int]
"""Median time and CPU time of a cycle, microseconds; how many cycles lacked a servo."""


@contextmanager
def simulator(ids: str, *options: str) -> Iterator[str]:
    """A bus in a process of its own; yields the path of its line."""
    with tempfile.TemporaryDirectory(prefix="bench-") as folder:
        link = str(Path(folder) / "bus")
        with child("-m", "benchmarks.simulator", link, "--ids", ids, *options):
            yield link


def one_round(cycle: Callable[[], bool], cycles: int) -> Round:
    """Warm up, then ``cycles`` one after the other."""
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
    """The median round of every client on one simulated bus."""
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
    """One line a client; the last column is to rustypot's speed or to the wire."""
    table = Table("client", "us a cycle", "CPU us", "cycles/s to rustypot's", "to the wire", "failed", title=title)
    theirs_us = found["rustypot"][0]
    for name, (cycle_us, cpu_us, failed) in found.items():
        to_wire = f"{cycle_us / on_wire_us:.3f}" if on_wire_us else "-"
        table.add_row(name, f"{cycle_us:.1f}", f"{cpu_us:.1f}", f"{theirs_us / cycle_us:.2f}", to_wire, str(failed))
    console.print(table)


def wire_us(make: str, servos: int) -> float:
    """The wire's own time for one cycle's bytes, as all but our own fast way send them: goals, question, answers."""
    series = SERIES[make]
    block, packets = series.blocks[0], series.protocol.packets
    entry = bytes(1 + series.goal_size)
    goals = len(packets.sync_write(series.goal_address, series.goal_size, entry * servos))
    question = len(packets.sync_read(range(1, servos + 1), block.address, block.size))
    bits: float = 10.0 * (goals + question + (block.size + packets.OVERHEAD) * servos)
    return bits * 1e6 / BAUD


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--make", choices=tuple(CLIENTS), default="feetech")
    parser.add_argument("--cycles", type=positive, default=1000)
    parser.add_argument("--rounds", type=positive, default=5)
    parser.add_argument("--servos", type=positive, default=7)
    arguments = parser.parse_args()
    most = MOST_SERVOS[arguments.make]
    if arguments.servos > most:
        parser.error(f"--servos takes at most {most} of {arguments.make}, not {arguments.servos}")
    console = Console(width=110)
    sizes = arguments.make, arguments.servos, arguments.cycles, arguments.rounds
    show(console, "no wire time", compare(*sizes), None)
    on_wire_us = wire_us(arguments.make, arguments.servos)
    paced = compare(*sizes, "--paced", str(BAUD))
    show(console, f"paced at {BAUD} bit/s: the wire itself {on_wire_us:.0f} us", paced, on_wire_us)
    show_silent(console, arguments.servos)


if __name__ == "__main__":
    with in_words():
        main()
