"""A bus of virtual X series servos whose registers encode the servo and the cycle, so that wrong or old values are
detected."""

from collections.abc import Mapping

import pytest

from drivers.bus.bus import Bus
from drivers.servos import x
from drivers.servos.dynamixel import ALARMED
from drivers.servos.register import ServoModel
from drivers.types import Reading, ServoFault, ServoState
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.packets.dynamixel import Code, InstructionParser
from sim_backend.packets.instructions import Instruction
from sim_backend.servos.dynamixel.servo import VirtualXServo

PERIOD_S = 0.015
BUDGET_S = 0.012
GROUP_READS = {Code.SYNC_READ, Code.FAST_SYNC_READ, Code.BULK_READ}


class TapedPort(VirtualPort):
    """A port that records the packets sent."""

    def __init__(self, bus: VirtualDynamixelBus, clock: SimulatedClock) -> None:
        super().__init__(bus, clock)
        self.sent: list[Instruction] = []
        self._parser = InstructionParser()

    def write(self, data: bytes) -> None:
        self.sent += self._parser.feed(data)
        super().write(data)


class TrueLine:
    """A bus with virtual servos that report known values. ``errors`` contains the hardware errors, by ID."""

    def __init__(self, models: Mapping[int, ServoModel], firmware: Mapping[int, int] | None = None) -> None:
        self.models = dict(models)
        self.ids = tuple(models)
        self.clock = SimulatedClock(50.0)
        self.servos = VirtualDynamixelBus.of(BenchPlant(self.ids), models, firmware=firmware)
        self.port = TapedPort(self.servos, self.clock)
        self.bus = Bus(self.port, self.clock, models)
        self.number = 0
        self.errors = dict.fromkeys(self.ids, 0)
        for servo in self.servos.servos:
            servo.firmware.publish = lambda servo=servo: self._publish(servo)  # type: ignore[method-assign,misc]

    def identified(self) -> "TrueLine":
        """Identify all servos, as a program does when it starts."""
        for servo_id, model in self.models.items():
            self.bus.identify(servo_id, model)
        self.bus.read_states(self.ids)
        self.port.sent.clear()
        return self

    def _publish(self, servo: VirtualXServo) -> None:
        servo_id = servo.servo_id
        servo.firmware.protection.status = self.errors[servo_id]
        for register, value in (
            (x.hardware_error_status, self.errors[servo_id]),
            (x.present_position, self.number * 7 - servo_id * 1000),
            (x.present_pwm, -servo_id),
            (x.present_current, 3 * servo_id - self.number % 50),
            (x.present_velocity, self.number % 50),
            (x.present_voltage, 100 + servo_id),
            (x.present_temperature, 30 + servo_id),
        ):
            servo.memory.put(register, value)

    def holds(self, servo_id: int, reading: ServoState) -> bool:
        """Return whether a state is the state of the servo in this cycle. Its alarms may be named, or reported as one
        unnamed alarm."""
        names = x.alarms(self.errors[servo_id])
        unit_a = x.current_unit_a(self.models[servo_id])
        wanted = (
            self.number * 7 - servo_id * 1000,
            round(self.number % 50 * x.VELOCITY_UNIT_COUNTS_S),
            -servo_id / x.FULL_PWM,
            pytest.approx((100 + servo_id) / 10.0),
            30.0 + servo_id,
            reading.alarms,
            unit_a and pytest.approx((3 * servo_id - self.number % 50) * unit_a),
        )
        return reading == wanted and reading.alarms in ((names, ALARMED) if names else ((),))

    def cycle(self) -> Mapping[int, Reading]:
        """Run one cycle and compare every value with the expected value."""
        self.number += 1
        next_s = self.clock.now() + PERIOD_S
        readings = self.bus.read_states(self.ids, self.clock.now() + BUDGET_S)
        for servo_id, reading in readings.items():
            assert isinstance(reading, ServoFault) or self.holds(servo_id, reading), (self.number, servo_id, reading)
        self.clock.sleep_until(next_s)
        return readings

    def faults(self) -> dict[int, str]:
        """Run one cycle and return the faults in it."""
        return {i: r.kind for i, r in self.cycle().items() if isinstance(r, ServoFault)}

    def taken(self) -> list[Instruction]:
        """Return the packets sent since the last call."""
        sent = self.port.sent[:]
        self.port.sent.clear()
        return sent

    def mapped(self) -> set[int]:
        """Return the servos that are read from the indirect block in the next cycle."""
        self.port.sent.clear()
        self.cycle()
        (question, *_) = [i for i in self.port.sent if i.code in GROUP_READS]
        number = lambda data: int.from_bytes(data, "little")  # noqa: E731
        p = question.parameters
        if question.code != Code.BULK_READ:
            return set(self.ids) if number(p[:2]) >= 208 else set()
        return {p[at] for at in range(0, len(p), 5) if number(p[at + 1 : at + 3]) >= 208}

    def reset(self, servo_id: int) -> None:
        """Reset a servo by a voltage drop that is too short to be noticed on the bus."""
        self.servos.servo(servo_id).power_cycle()
