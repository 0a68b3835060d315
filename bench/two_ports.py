"""Twelve servos on two ports at 100 cycles a second: ``python -m bench.two_ports [--cycles 1000]``.

The servos answer on two pseudo-terminals, each paced at 1 Mbit/s by a process of its own; IDs 1 to 6 are on both.
Above them all is as in ``servoloop up``: serial ports, buses, hardware component, loop. It runs twice: with the
ports overlapping, and one port after the other. Exits 1 if a cycle was missed with the ports overlapping.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from bench import simulator
from bench.arguments import free_path, positive
from controller.loop import ControlLoop
from controller.manager import ControllerManager
from drivers.bus import Reading, ServoBus
from drivers.clock import MonotonicClock
from drivers.feetech import sts
from drivers.feetech.bus import FeetechBus
from drivers.serial_port import SerialPort
from drivers.turns import Steps, Wait, finish
from hal.joint import Joint
from hal.servo_hardware import ServoHardware
from hal.types import JointLimits, JointState
from servoloop.realtime import claim_realtime_priority

BUSES = ("arm", "hand")
IDS = tuple(range(1, 7))
BAUD = 1_000_000
PERIOD_S = 0.01
MIDDLE_COUNTS = 2048
LIMITS = JointLimits(-2.0, 2.0, 4.0, 12.0, 120.0)
JOINTS = tuple(Joint(f"{bus}{i}", i, sts.STS3215, LIMITS, bus=bus) for bus in BUSES for i in IDS)


class ApartBus(FeetechBus):
    """Asks and waits in one step: what two ports are without overlapping."""

    def state_steps(self, servo_ids: Sequence[int], deadline_s: float) -> Steps[Mapping[int, Reading]]:
        yield Wait.LAST
        return finish(super().state_steps(servo_ids, deadline_s))


class TimedHardware(ServoHardware):
    """Notes how long each read takes."""

    reads_s: list[float]

    def reading(self) -> Steps[JointState]:
        begin_s = time.perf_counter()
        state = yield from super().reading()
        self.reads_s.append(time.perf_counter() - begin_s)
        return state


@dataclass(frozen=True, slots=True)
class Figures:
    """Of one run. Times in seconds."""

    cycles: int
    missed: int
    p50_s: float
    p99_s: float
    cpu_share: float
    faults: dict[str, int]


def serve(link: Path) -> None:
    """One port's servos, in the calling process, until it is ended."""
    # The servos keep no goal: they say what the bench writes, so that torque may go on.
    address = sts.goal_position.address
    simulator.TABLE[address : address + 2] = MIDDLE_COUNTS.to_bytes(2, "little")
    simulator.TABLE[sts.torque_enable.address] = 1
    claim_realtime_priority()
    line = simulator.Line(link, simulator.Servos(list(IDS)), BAUD)
    print("ready", flush=True)
    while True:
        line.serve_once()


@contextmanager
def served(link: Path) -> Iterator[str]:
    """``serve`` in a process of its own."""
    command = [sys.executable, "-m", "bench.two_ports", "--serve", str(link)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None and process.stdout.readline() == "ready\n"
        yield str(link)
    finally:
        process.kill()
        process.wait()


def run(devices: Mapping[str, str], make: type[FeetechBus], cycles: int) -> Figures:
    """So many cycles of the real loop, holding still."""
    clock = MonotonicClock()
    buses: dict[str, FeetechBus] = {}

    def open_buses() -> Mapping[str, ServoBus]:
        buses.update({name: make(SerialPort(device, BAUD, clock), clock) for name, device in devices.items()})
        return buses

    hardware = TimedHardware("twelve", JOINTS, open_buses, clock)
    hardware.reads_s = []
    limits = {joint.name: joint.limits for joint in JOINTS}
    loop = ControlLoop(hardware, ControllerManager(hardware.command_interfaces), limits, clock, PERIOD_S)
    hardware.configure()
    try:
        loop.activate()
        hardware.reads_s.clear()
        begin_s, cpu_s = time.perf_counter(), time.process_time()
        loop.run(lambda: loop.figures.cycles >= cycles)
        share = (time.process_time() - cpu_s) / (time.perf_counter() - begin_s)
        reads = sorted(hardware.reads_s)
        p50_s, p99_s = (reads[int(part * (len(reads) - 1))] for part in (0.5, 0.99))
        faults = [bus.counters.faults() for bus in buses.values()]
        total = {kind: sum(of[kind] for of in faults) for kind in faults[0]}
        return Figures(loop.figures.cycles, loop.figures.missed, p50_s, p99_s, share, total)
    finally:
        hardware.cleanup()


def main() -> int:
    """Returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--cycles", type=positive, default=1000)
    parser.add_argument("--serve", type=free_path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.serve:
        serve(arguments.serve)
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        devices = {name: stack.enter_context(served(Path(folder) / name)) for name in BUSES}
        claim_realtime_priority()
        figures = {
            "overlapped": run(devices, FeetechBus, arguments.cycles),
            "one after the other": run(devices, ApartBus, arguments.cycles),
        }
    print(f"{len(JOINTS)} servos on {len(BUSES)} ports, {1.0 / PERIOD_S:g} cycles a second, {BAUD} bit/s")
    print(f"{'':20} {'cycles':>7} {'missed':>7} {'read p50':>9} {'read p99':>9} {'CPU':>6}")
    for name, of in figures.items():
        read = f"{of.p50_s * 1e3:6.2f} ms {of.p99_s * 1e3:6.2f} ms"
        faults = {kind: count for kind, count in of.faults.items() if count}
        print(f"{name:20} {of.cycles:7} {of.missed:7} {read} {of.cpu_share:6.1%}  {faults or 'no faults'}")
    return 1 if figures["overlapped"].missed else 0


if __name__ == "__main__":
    raise SystemExit(main())
