"""Protection of a servo other than STS: status bits, protective torque, and release of the motor.

From the memory table: the status bits and the limits. If the drive reaches "overload torque" for "protection time", it
is limited to "protective torque". Each bit in "unloading condition" enables the corresponding protection. Assumed,
because the table does not describe it:
- Overload is latched until the torque switch is written, or until a new goal leads away from the blocked direction.
  Repeating the same goal does not clear the latch.
- Overcurrent releases the motor and is latched in the same way.
- Voltage and temperature errors are reported, and the motor is released, only while the value is out of range.
"""

from typing import Final, Protocol

from drivers.servos import sts
from drivers.servos.register import Register

VOLTAGE: Final = 1 << 0
TEMPERATURE: Final = 1 << 2
CURRENT: Final = 1 << 3
OVERLOAD: Final = 1 << 5

_TIME_UNIT_S: Final = 0.01


class Limits(Protocol):
    """The part of the control table that contains the limits."""

    def get(self, register: Register) -> int: ...


class Protection:
    """Protection of one servo. The motor driver follows ``duty_limit`` and ``released``."""

    def __init__(self) -> None:
        self.status = 0
        self.duty_limit = 1.0
        self.released = False
        self.blocked_direction = 0.0
        """Drive at which a protection was latched; 0 if no protection is latched."""
        self._overload_s = 0.0
        self._overcurrent_s = 0.0

    def load(self, memory: Limits) -> None:
        """Load the limits from the registers."""
        self._acts_on = memory.get(sts.unloading_condition)
        self._highest_v = memory.get(sts.max_voltage) * sts.VOLTAGE_UNIT_V
        self._lowest_v = memory.get(sts.min_voltage) * sts.VOLTAGE_UNIT_V
        self._hottest_c = memory.get(sts.max_temperature)
        self._overload_duty = memory.get(sts.overload_torque) / 100.0
        self._overload_limit_s = memory.get(sts.protection_time) * _TIME_UNIT_S
        self._protective_duty = memory.get(sts.protective_torque) / 100.0
        self._overcurrent_a = memory.get(sts.protection_current) * sts.CURRENT_UNIT_A
        self._overcurrent_limit_s = memory.get(sts.overcurrent_time) * _TIME_UNIT_S

    def clear(self) -> None:
        """Clear the latched protections."""
        self._overload_s = self._overcurrent_s = self.blocked_direction = 0.0
        self.status &= ~(OVERLOAD | CURRENT)
        self._act()

    def watch(self, dt_s: float, duty: float, current_a: float, voltage_v: float, temperature_c: float) -> None:
        """Check the motor after a step of ``dt_s``."""
        latched = self.status & (OVERLOAD | CURRENT)
        over = abs(duty) >= self._overload_duty
        self._overload_s = self._overload_s + dt_s if over else 0.0
        if self._overload_s >= self._overload_limit_s > 0.0:
            latched |= OVERLOAD
        over = abs(current_a) >= self._overcurrent_a
        self._overcurrent_s = self._overcurrent_s + dt_s if over else 0.0
        if self._overcurrent_s >= self._overcurrent_limit_s > 0.0:
            latched |= CURRENT
        if latched and not self.blocked_direction:
            self.blocked_direction = duty
        if not self._lowest_v <= voltage_v <= self._highest_v:
            latched |= VOLTAGE
        if temperature_c > self._hottest_c:
            latched |= TEMPERATURE
        self.status = latched
        self._act()

    def _act(self) -> None:
        acting = self.status & self._acts_on
        self.released = bool(acting & (VOLTAGE | TEMPERATURE | CURRENT))
        self.duty_limit = self._protective_duty if acting & OVERLOAD else 1.0
