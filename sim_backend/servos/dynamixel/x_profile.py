"""Motion profile of the X series: a step, a velocity limit, or a fixed duration. The profile also determines the moving
status.

From the e-manual: if no profile velocity is set, the profile is a step. The duration of a time-based profile is
``profile_velocity`` milliseconds. The acceleration phase of the profile takes ``profile_acceleration`` milliseconds,
but at most half of the total time. Assumed:
- A time-based profile starts at rest. If a new goal arrives during a motion, the duration applies to the remaining
  distance.
- A servo is in position if the error is at most 10 counts, and reports a following error if it exceeds 100 counts.
"""

from typing import Final

from drivers.servos import x
from sim_backend.servos.generic.motion_profile import UNLIMITED, MotionProfile

IN_POSITION, ONGOING, FOLLOWING_ERROR = 1 << 0, 1 << 1, 1 << 3
"""Bits of the moving status."""
STEP, RECTANGULAR, TRIANGULAR, TRAPEZOIDAL = (kind << 4 for kind in range(4))
"""Profile types in the moving status."""
_IN_POSITION_COUNTS: Final = 10.0
_FOLLOWING_COUNTS: Final = 100.0


class XProfile(MotionProfile):
    """Profile of one servo, together with its type."""

    __slots__ = ("_timed", "kind")

    def __init__(self) -> None:
        super().__init__()
        self.kind = STEP
        """Type of the profile, as reported in the moving status."""
        self._timed: tuple[float, int, int] | None = None
        """Goal, duration and ramp time for which the time-based profile was last computed."""

    def restart(self, position: float) -> None:
        super().restart(position)
        self._timed = None

    def limit(self, velocity: int, acceleration: int) -> None:
        """Set the velocity and acceleration limits from these register values."""
        self._timed = None
        self.speed = velocity * x.VELOCITY_UNIT_COUNTS_S or UNLIMITED
        self.acceleration = acceleration * x.ACCELERATION_UNIT_COUNTS_S2 if velocity and acceleration else UNLIMITED
        self._classify()

    def take(self, span_ms: int, ramp_ms: int) -> None:
        """Set the duration of the motion to the current goal."""
        if self._timed == (self.goal, span_ms, ramp_ms):
            return
        self._timed = (self.goal, span_ms, ramp_ms)
        distance, ramp_s = abs(self.goal - self.position), min(ramp_ms, span_ms / 2) / 1e3
        self.speed = self.acceleration = UNLIMITED
        if span_ms and distance:
            self.speed = distance / (span_ms / 1e3 - ramp_s)
            self.acceleration = self.speed / ramp_s if ramp_s else UNLIMITED
        self._classify()

    def _classify(self) -> None:
        if self.done:  # the reported type is that of the last motion
            return
        if self.speed == UNLIMITED:
            self.kind = STEP
        elif self.acceleration == UNLIMITED:
            self.kind = RECTANGULAR
        else:
            reaches_speed = self.speed**2 / self.acceleration <= abs(self.goal - self.position) * (1.0 + 1e-9)
            self.kind = TRAPEZOIDAL if reaches_speed else TRIANGULAR

    def status(self, position: float) -> int:
        """Return the moving status of a servo at this position."""
        status = self.kind
        if not self.done:
            status |= ONGOING
        if abs(self.goal - position) <= _IN_POSITION_COUNTS:
            status |= IN_POSITION
        if abs(self.position - position) > _FOLLOWING_COUNTS:
            status |= FOLLOWING_ERROR
        return status
