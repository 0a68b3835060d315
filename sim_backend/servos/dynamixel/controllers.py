"""Control loops of Dynamixel X series servos. Each loop returns a fraction of full drive.

From the e-manual: the structure of the loops and the scale of the gains. Assumed:
- The loops run once per millisecond, and their output has the same unit as ``goal_pwm``.
- The inputs of the feedforward gains are in counts/ms and counts/ms^2, and the input of the velocity gains is in units
  of 0.229 rpm.
"""

from typing import Final

from drivers.servos import x
from sim_backend.servos.generic.motion_profile import UNLIMITED, MotionProfile

LOOP_S: Final = 0.001
P_DIVISOR: Final = 128.0
"""Scale of the P gain according to the e-manual."""
I_DIVISOR: Final = 65536.0
D_DIVISOR: Final = 16.0
FEEDFORWARD_DIVISOR: Final = 4.0


class PositionLoop:
    """PID controller with feedforward from the profile. Positions are in counts."""

    __slots__ = ("_integral", "_velocity", "d", "ff_acceleration", "ff_velocity", "i", "p")

    def __init__(self) -> None:
        self.p = self.i = self.d = self.ff_velocity = self.ff_acceleration = 0.0
        """Gains, as fractions of full drive per count, in units of counts and seconds."""
        self.restart()

    def restart(self) -> None:
        """Clear the stored state, as when the torque is enabled."""
        self._integral = self._velocity = 0.0

    def step(self, dt_s: float, profile: MotionProfile, position: float, velocity: float) -> float:
        """Return the drive after a step of ``dt_s``."""
        error, wanted = profile.position - position, profile.velocity
        duty = self.p * error + self.d * (wanted - velocity)
        if self.i:
            self._integral = min(max(self._integral + self.i * error * dt_s, -1.0), 1.0)
            duty += self._integral
        if self.ff_velocity or self.ff_acceleration:
            duty += self.ff_velocity * wanted + self.ff_acceleration * (wanted - self._velocity) / dt_s
        self._velocity = wanted
        return duty


class VelocityLoop:
    """PI velocity controller, which reaches its goal velocity with limited acceleration. Velocities are in counts/s."""

    __slots__ = ("_integral", "acceleration", "goal", "i", "p", "trajectory")

    def __init__(self) -> None:
        self.p = self.i = self.goal = 0.0
        self.acceleration = UNLIMITED
        self.restart()

    def restart(self, velocity: float = 0.0) -> None:
        """Start at this velocity."""
        self._integral = 0.0
        self.trajectory = velocity

    def step(self, dt_s: float, velocity: float) -> float:
        """Return the drive after a step of ``dt_s``."""
        change = self.acceleration * dt_s
        self.trajectory = min(max(self.goal, self.trajectory - change), self.trajectory + change)
        error = self.trajectory - velocity
        self._integral = min(max(self._integral + self.i * error * dt_s, -1.0), 1.0)
        return self.p * error + self._integral


def position_gains(loop: PositionLoop, gains: tuple[int, int, int, int, int], p_divisor: float) -> None:
    """Decode the P, I and D registers, and the registers of both feedforward gains (velocity, acceleration)."""
    p, i, d, ff_velocity, ff_acceleration = gains
    loop.p = p / p_divisor / x.FULL_PWM
    loop.i = i / I_DIVISOR / x.FULL_PWM / LOOP_S
    loop.d = d / D_DIVISOR / x.FULL_PWM * LOOP_S
    loop.ff_velocity = ff_velocity / FEEDFORWARD_DIVISOR / x.FULL_PWM * LOOP_S
    loop.ff_acceleration = ff_acceleration / FEEDFORWARD_DIVISOR / x.FULL_PWM * LOOP_S**2


def velocity_gains(loop: VelocityLoop, p: int, i: int) -> None:
    """Decode the P and I registers."""
    unit = x.VELOCITY_UNIT_COUNTS_S * x.FULL_PWM
    loop.p = p / P_DIVISOR / unit
    loop.i = i / I_DIVISOR / unit / LOOP_S
