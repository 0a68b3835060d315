"""Bus watchdog of the X series.

From the e-manual: if torque is enabled and the servo receives no instruction for ``bus_watchdog`` units of 20 ms, the
servo stops and the register reads -1. Goals are then rejected until 0 is written. Any instruction on the bus restarts
the timer. Assumed: the servo stops with a goal velocity, goal PWM and goal current of 0, or at its current position.
"""

from typing import Final

from drivers.servos import x
from sim_backend.servos.dynamixel.modes import CURRENT, PWM
from sim_backend.servos.generic.firmware import FirmwareMemory

TRIPPED: Final = 255
"""Value of the register after the watchdog has stopped the servo."""
_UNIT_S: Final = 0.02
LOCKED: Final = (x.goal_pwm, x.goal_velocity, x.goal_current, x.goal_position)
"""Registers that are locked after the watchdog has stopped the servo."""


class Watchdog:
    """Watchdog timer of one servo."""

    __slots__ = ("_limit_s", "_quiet_s")

    def __init__(self) -> None:
        self._limit_s = self._quiet_s = 0.0

    def load(self, memory: FirmwareMemory) -> None:
        """Load the timeout from the register."""
        units = memory.get(x.bus_watchdog)
        self._limit_s = 0.0 if units == TRIPPED else units * _UNIT_S

    def heard(self) -> None:
        """Restart the timer after an instruction."""
        self._quiet_s = 0.0

    def expired(self, dt_s: float) -> bool:
        """Advance the timer. Return whether the timeout has expired and the servo must stop."""
        if not self._limit_s:
            return False
        self._quiet_s += dt_s
        return self._quiet_s > self._limit_s


def stop(memory: FirmwareMemory, position: float, *, measures_current: bool) -> None:
    """Write the registers of a servo that the watchdog has stopped."""
    memory.put(x.bus_watchdog, TRIPPED)
    for goal in (x.goal_velocity, x.profile_velocity, x.profile_acceleration):
        memory.put(goal, 0)
    if memory.get(x.operating_mode) == PWM:
        memory.put(x.goal_pwm, 0)
    if measures_current and memory.get(x.operating_mode) == CURRENT:
        memory.put(x.goal_current, 0)
    memory.put(x.goal_position, int(position))
