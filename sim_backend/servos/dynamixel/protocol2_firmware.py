"""Common firmware of all virtual protocol 2.0 servos: latched errors and a smoothed speed register.

Assumed:
- An overload is full drive for two seconds at less than half of the no-load speed.
- All errors last until a reboot.
- The reported speed has a 15 ms filter in addition to the filter of the control loop. The reported speed of a shaft
  that is held between two counts is therefore 0.
"""

from abc import abstractmethod
from dataclasses import dataclass
from typing import Final

from drivers.servos.register import Register
from sim_backend.servos.generic.firmware import GenericFirmware
from sim_backend.servos.generic.protection import Limits, Protection

SHOWN_FILTER_S: Final = 0.015
OVERLOAD_DUTY: Final = 0.98
OVERLOAD_S: Final = 2.0
OVERLOAD_SHARE: Final = 0.5
"""Fraction of the stall current above which full drive is considered an overload."""


@dataclass(frozen=True, slots=True)
class ErrorBits:
    """Registers that contain a table's limits, and the table's error bits."""

    shutdown: Register
    min_voltage: Register
    max_voltage: Register
    max_temperature: Register
    volts_per_unit: float
    voltage: int
    temperature: int
    overload: int


class LatchedProtection(Protection):
    """Hardware errors, which last until a reboot. The errors selected in ``shutdown`` switch the motor off."""

    def __init__(self, bits: ErrorBits, resistance_ohm: float) -> None:
        super().__init__()
        self._bits = bits
        self._resistance_ohm = resistance_ohm

    def load(self, memory: Limits) -> None:
        """Load the limits from the registers."""
        bits = self._bits
        self._acts_on = memory.get(bits.shutdown)
        self._highest_v = memory.get(bits.max_voltage) * bits.volts_per_unit
        self._lowest_v = memory.get(bits.min_voltage) * bits.volts_per_unit
        self._hottest_c = memory.get(bits.max_temperature)

    def watch(self, dt_s: float, duty: float, current_a: float, voltage_v: float, temperature_c: float) -> None:
        """Check the motor after a step of ``dt_s``."""
        bits = self._bits
        loaded = abs(current_a) * self._resistance_ohm >= OVERLOAD_SHARE * voltage_v
        self._overload_s = self._overload_s + dt_s if loaded and abs(duty) >= OVERLOAD_DUTY else 0.0
        if self._overload_s >= OVERLOAD_S:
            self.status |= bits.overload
        if not self._lowest_v <= voltage_v <= self._highest_v:
            self.status |= bits.voltage
        if temperature_c > self._hottest_c:
            self.status |= bits.temperature
        self.released = bool(self.status & self._acts_on)


class Protocol2Firmware(GenericFirmware):
    """Control loop of one servo. Subclasses define the registers of a series."""

    BITS: ErrorBits

    def new_protection(self) -> Protection:
        return LatchedProtection(self.BITS, self._motor.resistance_ohm)

    def observe(self, angle_rad: float) -> None:
        super().observe(angle_rad)
        self._shown_velocity = 0.0
        self._hold_here()

    @abstractmethod
    def _hold_here(self) -> None:
        """Set the goal to the present position, as after power-on."""

    def step(self, dt_s: float, angle_rad: float, velocity_rad_s: float) -> float:
        torque_nm = super().step(dt_s, angle_rad, velocity_rad_s)
        self._shown_velocity += (self._velocity - self._shown_velocity) * dt_s / (SHOWN_FILTER_S + dt_s)
        return torque_nm

    def _switch(self) -> None:
        if self.protection.released:
            self._shut_down()
            self._acting = False
        super()._switch()

    @abstractmethod
    def _shut_down(self) -> None:
        """Write the effects of a shutdown to the table."""
