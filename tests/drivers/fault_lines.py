"""Buses of virtual servos of every make, with registers that encode the servo and the cycle to expose wrong values."""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import pytest

from drivers.bus.bus import Bus
from drivers.bus.counters import ServoCounters
from drivers.servos import ax_mx as dxl
from drivers.servos import scs, sts, x
from drivers.servos.catalog import series_of
from drivers.servos.register import ByteOrder, Register, ServoModel
from drivers.types import Reading, ServoFault, ServoGoal, ServoState
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.feetech import VirtualBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.line.line import ServoLine
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.servos.dynamixel.servo import VirtualXServo
from tests.drivers.cycles import exchange

IDS = (1, 2, 3, 4, 5, 6, 7)
CYCLES = int(os.environ.get("SERVOLOOP_FAULT_CYCLES", "1000"))
"""Number of cycles of a test with line errors (``make soak``: 10,000). The number of cycles of tests marked ``soak`` is
scaled with it."""


@dataclass(frozen=True)
class Table:
    """Properties of a series' control table that the tests need, and the duration of a cycle of its servos."""

    period_s: float
    budget_s: float
    middle: int
    position: Register
    max_voltage: Register
    counts_s: Callable[[ServoModel], float]
    """Function that returns the velocity of one register unit, in counts/s."""
    full_load: int
    """Register value of full load, negative if the servo reports its load with the opposite sign."""
    order: ByteOrder = "little"


TABLES: dict[str, Table] = {
    "Feetech STS": Table(0.01, 0.008, 2048, sts.present_position, sts.max_voltage, lambda model: 1.0, -1000),
    "Feetech SCS": Table(0.02, 0.016, 512, scs.present_position, scs.max_voltage, lambda model: 1.0, 1000, "big"),
    "Dynamixel protocol 1.0": Table(
        0.02, 0.016, 512, dxl.present_position, dxl.max_voltage_limit,
        dxl.speed_unit_counts_s, dxl.FULL_TORQUE,
    ),
    "Dynamixel protocol 2.0": Table(
        0.015, 0.012, 2048, x.present_position, x.max_voltage_limit, lambda model: x.VELOCITY_UNIT_COUNTS_S, x.FULL_PWM
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Kind:
    """The servos on a bus."""

    name: str
    models: Mapping[int, ServoModel]
    one_by_one: bool = False
    """Whether each servo is read separately."""
    mapped: bool = False
    """Whether the state is read through indirect registers."""
    with_goals: bool = False
    """Whether goals are sent with every request once the first request has been answered."""

    @property
    def model(self) -> ServoModel:
        return self.models[IDS[0]]

    @property
    def waits(self) -> bool:
        """Whether a servo waits for the reply of the servo listed before it."""
        return series_of(self.model).protocol.waits_for_silent

    @cached_property
    def table(self) -> Table:
        return TABLES[series_of(self.model).protocol.name]

    @property
    def order(self) -> ByteOrder:
        return self.table.order


def mixed(*models: ServoModel) -> dict[int, ServoModel]:
    """Assign the models to the IDs in turn."""
    return {i: models[i % len(models)] for i in IDS}


READ_EACH = (
    Kind("scs0009", mixed(scs.SCS0009), one_by_one=True),
    Kind("scs15 and scs0009", mixed(scs.SCS15, scs.SCS0009), one_by_one=True),
    Kind("ax-12a", mixed(dxl.AX_12A), one_by_one=True),
    Kind("mx-28", mixed(dxl.MX_28)),
    Kind("ax-12a and mx-28", mixed(dxl.AX_12A, dxl.MX_28), one_by_one=True),
)
"""Kinds of servos without sync reads."""
KINDS = (
    Kind("sts3215", mixed(sts.STS3215)),
    Kind("xl430 and xm430", mixed(x.XM430_W350, x.XL430_W250)),
    Kind("xl430 and xm430, mapped", mixed(x.XM430_W350, x.XL430_W250), mapped=True),
    Kind("sts3215, with goals", mixed(sts.STS3215), with_goals=True),
    Kind("xl430 and xm430, with goals", mixed(x.XM430_W350, x.XL430_W250), with_goals=True),
    Kind("xl430 and xm430, mapped, with goals", mixed(x.XM430_W350, x.XL430_W250), mapped=True, with_goals=True),
    *READ_EACH,
)

every_kind = pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
every_servo = pytest.mark.parametrize(
    ("kind", "servo_id"),
    # The simplest group read and the mapped one are tested with every position of the silent servo. The others are
    # tested only with the first, the middle and the last position.
    [
        pytest.param(kind, servo_id, id=f"{kind.name}-{servo_id}")
        for kind in KINDS
        for servo_id in (IDS if kind is KINDS[0] or (kind.mapped and not kind.with_goals) else (1, 4, 7))
    ],
)


class Line:
    """A bus of virtual servos with its port, clock and faults."""

    def __init__(self, kind: Kind, port: type[VirtualPort] = VirtualPort, clock: SimulatedClock | None = None) -> None:
        self.kind = kind
        self.clock = clock or SimulatedClock(50.0)
        plant = BenchPlant(IDS, timestep_s=0.005)
        language = series_of(kind.model).protocol.name
        of = VirtualDynamixelBus.of if language == "Dynamixel protocol 2.0" else VirtualBus.of
        self.servos: ServoLine[Any] = of(plant, kind.models)
        self.faults = self.servos.faults
        self.port = port(self.servos, self.clock)
        self.bus = Bus(self.port, self.clock, kind.models)
        self.goals: dict[int, ServoGoal] = {}
        for servo_id in IDS if kind.mapped else ():
            self.bus.identify(servo_id, kind.models[servo_id])
        if kind.with_goals:
            self.goals = dict.fromkeys(IDS, ServoGoal(kind.table.middle))  # servos without torque do not move
            self.states(self.clock.now() + 0.1)

    def account(self, servo_id: int) -> ServoCounters:
        return self.bus.counters.of(servo_id)

    def states(self, deadline_s: float) -> Mapping[int, Reading]:
        """Read the states, and then write the goals, if there are any."""
        if self.goals:
            return exchange(self.bus, self.goals, IDS, deadline_s)
        return self.bus.read_states(IDS, deadline_s)

    def cycle(self) -> Mapping[int, Reading]:
        """Read the states within the time budget, and advance to the end of the period."""
        next_s = self.clock.now() + self.kind.table.period_s
        readings = self.states(self.clock.now() + self.kind.table.budget_s)
        self.clock.sleep_until(next_s)
        return readings

    def missing(self) -> dict[int, str]:
        """Run one cycle and return the faults in it."""
        return {i: r.kind for i, r in self.cycle().items() if isinstance(r, ServoFault)}

    def held(self, servo_id: int, register: Any) -> int:
        return self.servos.servo(servo_id).memory.get(register)


class Truth:
    """Fills the state registers with values that encode the servo and the ``number`` of the cycle."""

    def __init__(self, line: Line) -> None:
        self.kind = line.kind
        self.number = 0
        self._constant = {i: self._constant_of(i) for i in IDS}
        for servo in line.servos.servos:
            if series_of(self.kind.model).protocol.name == "Dynamixel protocol 2.0":
                servo.firmware.publish = self._publish_of(servo)
            else:
                servo.read = self._read_of(servo.servo_id, servo.read)

    def position(self, servo_id: int) -> int:
        return (self.number * 7 + servo_id * 1000) % 32768

    def _read_of(self, servo_id: int, held: Callable[[int, int], bytes]) -> Callable[[int, int], bytes]:
        """Return position, velocity, load, voltage and temperature, which are adjacent in the older protocols."""
        switch = series_of(self.kind.model).torque_enable.address

        def read(address: int, size: int) -> bytes:
            if address == switch:
                return held(address, size)
            words = (self.position(servo_id), servo_id, 5)
            block = b"".join(word.to_bytes(2, self.kind.order) for word in words)
            return (block + bytes((120, 30)) + bytes(range(size)))[:size]

        return read

    def _publish_of(self, servo: VirtualXServo) -> Callable[[], None]:
        def publish() -> None:
            for register, value in (
                (x.present_position, self.position(servo.servo_id)),
                (x.present_velocity, servo.servo_id),
                (x.present_pwm, 5),
                (x.present_current, -servo.servo_id),
                (x.present_voltage, 120),
                (x.present_temperature, 30),
            ):
                servo.memory.put(register, value)

        return publish

    def _constant_of(self, servo_id: int) -> tuple[Any, ...]:
        """Return all fields except for the position. They stay the same in every cycle."""
        table = self.kind.table
        model = self.kind.models[servo_id]
        velocity = round(servo_id * table.counts_s(model))
        load = pytest.approx(5 / table.full_load)
        unit_a = x.current_unit_a(model)
        current = unit_a and pytest.approx(-servo_id * unit_a)
        return velocity, load, pytest.approx(12.0), 30.0, (), current

    def holds(self, servo_id: int, reading: ServoState) -> bool:
        """Return whether a state is the complete state of the servo in this cycle."""
        return reading == (self.position(servo_id), *self._constant[servo_id])
