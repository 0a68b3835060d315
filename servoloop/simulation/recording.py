"""Record the motion of a simulated run, and compute its following error."""

from bisect import bisect_left
from dataclasses import dataclass, field

import numpy as np

from hal.types import FloatArray
from servoloop.recording.following_error import FollowingError, between_cycles


@dataclass(slots=True)
class Trace:
    """Actual joint positions in every millisecond, and reference positions in every cycle."""

    world_s: list[float] = field(default_factory=list)
    actual: list[FloatArray] = field(default_factory=list)
    cycle_s: list[float] = field(default_factory=list)
    position: list[FloatArray] = field(default_factory=list)
    velocity: list[FloatArray] = field(default_factory=list)

    def following_error(self) -> tuple[FloatArray, FloatArray]:
        """Return each joint's largest error and RMS error while moving, in rad, including the times between cycles."""
        error = self.following()
        return np.array(error.largest_rad), np.array(error.rms_moving_rad)

    def following(self, since_s: float = 0.0) -> FollowingError:
        """Return the following error since a time, including the times between cycles."""
        start = bisect_left(self.world_s, since_s)
        cycles, position, velocity = np.array(self.cycle_s), np.array(self.position), np.array(self.velocity)
        return between_cycles(self.world_s[start:], self.actual[start:], cycles, position, velocity)
