"""Lines of virtual servos without a sync read, for the tests of their bus."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from drivers.bus import ServoFault, ServoState
from drivers.counters import ServoCounters
from drivers.dynamixel1 import tables as dxl
from drivers.feetech import scs
from drivers.read_each.bus import ReadEachBus
from drivers.read_each.series import DYNAMIXEL1, SCS, Series
from drivers.registers import ByteOrder, ServoModel
from sim_backend.bus import VirtualBus
from sim_backend.clock import SimulatedClock
from sim_backend.plant import BenchPlant
from sim_backend.port import VirtualPort

IDS = (1, 2, 3, 4, 5, 6, 7)
PERIOD_S = 0.02
BUDGET_S = 0.016


@dataclass(frozen=True)
class Kind:
    """Which servos are on a line."""

    name: str
    models: Mapping[int, ServoModel]
    series: Series

    @property
    def model(self) -> ServoModel:
        return self.models[IDS[0]]

    @property
    def order(self) -> ByteOrder:
        return self.series.byte_order


def _mixed(*models: ServoModel) -> dict[int, ServoModel]:
    return {i: models[i % len(models)] for i in IDS}


KINDS = (
    Kind("scs0009", _mixed(scs.SCS0009), SCS),
    Kind("scs15 and scs0009", _mixed(scs.SCS15, scs.SCS0009), SCS),
    Kind("ax-12a", _mixed(dxl.AX_12A), DYNAMIXEL1),
    Kind("mx-28", _mixed(dxl.MX_28), DYNAMIXEL1),
    Kind("ax-12a and mx-28", _mixed(dxl.AX_12A, dxl.MX_28), DYNAMIXEL1),
)


class Line:
    """A bus of virtual servos and everything around it."""

    def __init__(self, kind: Kind, port: type[VirtualPort] = VirtualPort) -> None:
        self.kind = kind
        self.clock = SimulatedClock(50.0)
        self.servos = VirtualBus.of(BenchPlant(IDS, timestep_s=0.005), kind.models)
        self.faults = self.servos.faults
        self.port = port(self.servos, self.clock)
        self.bus = ReadEachBus(self.port, self.clock, kind.models)

    def account(self, servo_id: int) -> ServoCounters:
        return self.bus.counters.of(servo_id)

    def cycle(self) -> dict[int, ServoState | ServoFault]:
        next_s = self.clock.now() + PERIOD_S
        readings = self.bus.read_states(IDS, self.clock.now() + BUDGET_S)
        self.clock.sleep_until(next_s)
        return readings

    def missing(self) -> dict[int, str]:
        return {i: r.kind for i, r in self.cycle().items() if isinstance(r, ServoFault)}

    def held(self, servo_id: int, register: Any) -> int:
        return self.servos.servo(servo_id).memory.get(register)


class Truth:
    """Position registers that say the servo and the time, so that a wrong or an old value shows."""

    def __init__(self, line: Line) -> None:
        self.order = line.kind.order
        self.number = 0
        for servo in line.servos.servos:
            servo.read = self._read_of(servo.servo_id)  # type: ignore[method-assign]

    def position(self, servo_id: int) -> int:
        return (self.number * 7 + servo_id * 1000) % 32768

    def _read_of(self, servo_id: int):  # type: ignore[no-untyped-def]
        def read(address: int, size: int) -> bytes:
            words = (self.position(servo_id), servo_id, 5)
            block = b"".join(word.to_bytes(2, self.order) for word in words)
            return (block + bytes((120, 30)) + bytes(range(size)))[:size]

        return read

    def holds(self, servo_id: int, reading: ServoState) -> bool:
        return (reading.position_counts, reading.temperature_c, reading.alarms) == (self.position(servo_id), 30.0, ())
