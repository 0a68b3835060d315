"""Plan a goal without interpolation: the reference jumps from point to point, and the velocity limit slows the
command."""

from bisect import bisect_right
from dataclasses import dataclass

from controller.motion import Kinematics, Path
from controller.trajectory.waypoints import Waypoints
from hal.types import FloatArray


@dataclass(frozen=True, slots=True)
class StepPlan:
    """Plan whose reference jumps from point to point."""

    waypoints: Waypoints

    def join(self, reference: Kinematics, waited_s: float) -> Path:
        """Return a path that holds the reference until the time of the first point."""
        times_s = tuple((self.waypoints.times_s - waited_s).tolist())
        return StepPath(reference.position, times_s, self.waypoints.position, max(times_s[-1], 0.0))


@dataclass(frozen=True, slots=True)
class StepPath:
    """Path that holds the start until the time of the first point.

    From the time of each point onward, the path holds the next point.

    ``positions`` has shape (m, n).
    """

    start: FloatArray
    times_s: tuple[float, ...]
    positions: FloatArray
    duration_s: float

    @property
    def asked_s(self) -> float:
        """Requested duration, in seconds. A step path never takes longer."""
        return self.duration_s

    def sample(self, time_s: float) -> Kinematics:
        """Return the kinematics at ``time_s`` after the start."""
        if time_s < self.times_s[0]:
            return Kinematics.at_rest(self.start)
        index = min(bisect_right(self.times_s, time_s), len(self.times_s) - 1)
        return Kinematics.at_rest(self.positions[index])
