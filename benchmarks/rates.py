"""Run seven servos on one port at rates from 20 to 500 Hz: ``python -m benchmarks.rates [--cycles 1000]``.

The servos reply on a pseudo-terminal at 1 Mbit/s, in a separate process. There are three rows for each rate:

- ``servoloop up``: the whole stack as a process, with the shipped controllers, ROS and a subscriber (``--seconds``).
- Only the loop: the stack's serial port, bus, hardware component and loop, without controllers and ROS.
- Only system calls, which send the same bytes at the same rate. If this row has missed cycles, the machine itself is
  the cause.

A value counts as missing if a cycle ended without the state of a servo. "Threads" is the processor time of the main
thread, which serves ROS clients, and of the three busiest other threads: usually the loop, the publisher of cycles and
DDS. "Ready" is the time from the start of the process until it is ready for clients, and "memory" is its resident
memory.
"""

import argparse
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from benchmarks import two_ports
from benchmarks.clients.feetech import no_driver
from benchmarks.processes import stack_rates
from benchmarks.processes.children import child
from benchmarks.shared.arguments import free_path, in_words, positive
from controller.loop import ControlLoop
from controller.manager.manager import ControllerManager
from drivers.bus.bus import Bus
from drivers.clock import MonotonicClock
from drivers.port.serial_port import SerialPort
from drivers.servos import sts
from hal.components.component_set import ComponentSet
from hal.joint import Joint
from hal.servos.servo_hardware import ServoHardware
from hal.types import JointState
from servoloop.stack.processes import PRIORITY, realtime_priority

IDS = tuple(range(1, 8))
RATES_HZ = (20, 50, 100, 200, 300, 400, 500)
JOINTS = tuple(Joint(f"joint{i}", i, sts.STS3215, two_ports.LIMITS) for i in IDS)


@dataclass(frozen=True, slots=True)
class RateFigures:
    """Results of one rate."""

    cycles: int
    missed: int
    unmeasured: int
    """Number of cycles in which no value was received."""
    missing: float
    """Fraction of missing values."""
    cpu_share: float


@contextmanager
def served(link: Path) -> Iterator[str]:
    """Serve the servos in a separate process."""
    with child("-m", "benchmarks.rates", "--serve", str(link)):
        yield str(link)


def run(device: str, rate_hz: float, cycles: int) -> RateFigures:
    """Run ``cycles`` cycles of the real loop, which holds the arm still."""
    clock = MonotonicClock()
    missing = 0

    def count(state: JointState) -> None:
        nonlocal missing
        missing += len(state.faults)

    hardware = ServoHardware("seven", JOINTS, lambda: Bus(SerialPort(device, two_ports.BAUD, clock), clock), clock)
    limits = {joint.name: joint.limits for joint in JOINTS}
    components = ComponentSet([hardware], clock)
    manager = ControllerManager(components, limits)
    loop = ControlLoop(components, manager, limits, clock, 1.0 / rate_hz)
    loop.on_cycle = count
    hardware.configure()
    try:
        loop.activate()
        begin_s, cpu_s = time.perf_counter(), time.process_time()
        loop.run(lambda: loop.figures.cycles >= cycles)
        share = (time.process_time() - cpu_s) / (time.perf_counter() - begin_s)
        figures = loop.figures
        return RateFigures(figures.cycles, figures.missed, figures.unmeasured, missing / (cycles * len(JOINTS)), share)
    finally:
        hardware.cleanup()


def missed_without_driver(device: str, rate_hz: float, cycles: int) -> int:
    """Return the number of missed cycles when only system calls are used. Overdue cycles are skipped, as in the control
    loop."""
    cycle, close = no_driver(device, two_ports.BAUD, IDS)
    clock, period_s, missed = MonotonicClock(), 1.0 / rate_hz, 0
    due_s = clock.now() + period_s
    for _ in range(cycles):
        clock.sleep_until(due_s)
        cycle()
        late = int((clock.now() - due_s) / period_s)
        missed += late
        due_s += (1 + late) * period_s
    close()
    return missed


def main() -> None:
    """Run the measurements and print the results."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--cycles", type=positive, default=1000)
    parser.add_argument("--serve", type=free_path, help=argparse.SUPPRESS)
    parser.add_argument("--seconds", type=float, default=20.0, help="run time of servoloop up at each rate")
    parser.add_argument("--rates", type=float, nargs="+", default=RATES_HZ, metavar="HZ")
    arguments = parser.parse_args()
    if arguments.serve:
        two_ports.serve(arguments.serve, IDS, stack_rates.StoringServos)
    title = f"{len(IDS)} STS3215 on one port, {two_ports.BAUD} bit/s"
    columns = "rate", "program", "cycles", "missed cycles", "missing values", "CPU", "threads", "ready", "memory"
    table = Table(*columns, title=title)
    with tempfile.TemporaryDirectory() as folder, served(Path(folder) / "line") as device:
        for rate_hz in arguments.rates:
            whole = stack_rates.measure(device, rate_hz, arguments.seconds, Path(folder))
            with realtime_priority(PRIORITY):
                of = run(device, rate_hz, arguments.cycles)
                bare = missed_without_driver(device, rate_hz, arguments.cycles)
            threads = " ".join(f"{share:.1%}" for share in whole.thread_shares[:4])
            shares = f"{whole.missing:.2%}", f"{whole.cpu_share:.1%}", threads
            size = f"{whole.ready_s:.1f} s", f"{whole.memory_bytes / 1e6:.0f} MB"
            table.add_row(f"{rate_hz:g} Hz", "servoloop up", str(whole.cycles), str(whole.missed), *shares, *size)
            alone = f"{of.missing:.2%}", f"{of.cpu_share:.1%}"
            table.add_row("", "loop alone", str(of.cycles), str(of.missed), *alone)
            table.add_row("", "system calls alone", str(arguments.cycles), str(bare))
    Console(width=130).print(table)


if __name__ == "__main__":
    with in_words():
        main()
