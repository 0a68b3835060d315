"""Run twelve servos on two ports at 100 cycles per second: ``python -m benchmarks.two_ports [--cycles 1000]``.

The servos reply on two pseudo-terminals at 1 Mbit/s, each in a separate process. IDs 1 to 6 exist on both ports. The
serial ports, buses, hardware component and loop are those of ``servoloop up``. The benchmark consists of two runs: one
reads both ports at the same time, and the other reads the ports one after the other. The exit status is 1 if a cycle
was missed in the run that reads both ports at the same time.
"""

import argparse
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from benchmarks import simulator
from benchmarks.processes.children import child
from benchmarks.shared.arguments import free_path, in_words, positive
from controller.loop import ControlLoop
from controller.manager.manager import ControllerManager
from drivers.bus.bus import Bus
from drivers.clock import MonotonicClock
from drivers.port.serial_port import SerialPort
from drivers.servos import sts
from drivers.types import Reading
from hal.components.component_set import ComponentSet
from hal.joint import Joint
from hal.servos.servo_hardware import ServoHardware
from hal.types import JointLimits, JointState
from servoloop.stack.processes import claim_realtime_priority

BUSES = ("arm", "hand")
IDS = tuple(range(1, 7))
BAUD = 1_000_000
PERIOD_S = 0.01
MIDDLE_COUNTS = 2048
LIMITS = JointLimits(-2.0, 2.0, 4.0, 12.0, 120.0)
JOINTS = tuple(Joint(f"{bus}{i}", i, sts.STS3215, LIMITS, bus=bus) for bus in BUSES for i in IDS)


class ApartBus(Bus):
    """Bus that sends a request and waits for the replies in one step, so that reads from two ports do not overlap."""

    def request(self, servo_ids: Sequence[int], deadline_s: float) -> None:
        self._later = servo_ids, deadline_s

    def receive(self) -> Mapping[int, Reading]:
        super().request(*self._later)
        return super().receive()


class TimedHardware(ServoHardware):
    """Hardware component that records the duration of each read."""

    reads_s: list[float]

    def request(self, deadline_s: float | None = None) -> None:
        self._begin_s = time.perf_counter()
        super().request(deadline_s)

    def read(self) -> JointState:
        state = super().read()
        self.reads_s.append(time.perf_counter() - self._begin_s)
        return state


@dataclass(frozen=True, slots=True)
class TwoPortFigures:
    """Results of one run."""

    cycles: int
    missed: int
    p50_s: float
    p99_s: float
    cpu_share: float
    faults: dict[str, int]


def serve(
    link: Path, servo_ids: Sequence[int] = IDS, kind: Callable[[list[int]], simulator.Servos] = simulator.Servos
) -> None:
    """Serve the servos of one port, created by ``kind``, in the calling process until the process is stopped."""
    # The servos do not move, and they report the goals that the benchmark sends, so torque may be enabled.
    address = sts.goal_position.address
    simulator.TABLE[address : address + 2] = MIDDLE_COUNTS.to_bytes(2, "little")
    simulator.TABLE[sts.torque_enable.address] = 1
    claim_realtime_priority()
    line = simulator.SimulatedBus(link, kind(list(servo_ids)), BAUD)
    print("ready", flush=True)
    while True:
        line.serve_once()


@contextmanager
def served(link: Path) -> Iterator[str]:
    """Run ``serve`` in a separate process."""
    with child("-m", "benchmarks.two_ports", "--serve", str(link)):
        yield str(link)


def run(devices: Mapping[str, str], make: type[Bus], cycles: int) -> TwoPortFigures:
    """Run ``cycles`` cycles of the real loop, which holds the arm still."""
    clock = MonotonicClock()
    buses: dict[str, Bus] = {}

    def open_buses() -> Mapping[str, Bus]:
        buses.update({name: make(SerialPort(device, BAUD, clock), clock) for name, device in devices.items()})
        return buses

    hardware = TimedHardware("twelve", JOINTS, open_buses, clock)
    hardware.reads_s = []
    limits = {joint.name: joint.limits for joint in JOINTS}
    components = ComponentSet([hardware], clock)
    loop = ControlLoop(components, ControllerManager(components, limits), limits, clock, PERIOD_S)
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
        return TwoPortFigures(loop.figures.cycles, loop.figures.missed, p50_s, p99_s, share, total)
    finally:
        hardware.cleanup()


def main() -> int:
    """Measure, print the results and return the exit status."""
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
            "overlapped": run(devices, Bus, arguments.cycles),
            "one after the other": run(devices, ApartBus, arguments.cycles),
        }
    print(f"{len(JOINTS)} servos on {len(BUSES)} ports, {1.0 / PERIOD_S:g} cycles per second, {BAUD} bit/s")
    print(f"{'':20} {'cycles':>7} {'missed':>7} {'read p50':>9} {'read p99':>9} {'CPU':>6}")
    for name, of in figures.items():
        read = f"{of.p50_s * 1e3:6.2f} ms {of.p99_s * 1e3:6.2f} ms"
        faults = {kind: count for kind, count in of.faults.items() if count}
        print(f"{name:20} {of.cycles:7} {of.missed:7} {read} {of.cpu_share:6.1%}  {faults or 'no faults'}")
    return 1 if figures["overlapped"].missed else 0


if __name__ == "__main__":
    with in_words():
        raise SystemExit(main())
