"""No interpolation: the reference leaps from point to point, and the command follows at the velocity limit."""

from bisect import bisect_right
from dataclasses import dataclass

from controller.motion import Kinematics, Path
from controller.trajectory.waypoints import Waypoints
from hal.types import FloatArray


@dataclass(frozen=True, slots=True)
class StepPlan:
    """A plan of leaps, which the command follows at the velocity limit."""

    waypoints: Waypoints

    def join(self, reference: Kinematics, waited_s: float) -> Path:
        """The path stands at the reference until the first point's time."""
        times_s = tuple((self.waypoints.times_s - waited_s).tolist())
        return StepPath(reference.position, times_s, self.waypoints.position, max(times_s[-1], 0.0))


@dataclass(frozen=True, slots=True)
class StepPath:
    """The start until the first point's time, and from each point's time on the next one; ``positions`` (m, n)."""

    start: FloatArray
    times_s: tuple[float, ...]
    positions: FloatArray
    duration_s: float

    @property
    def asked_s(self) -> float:
        """The duration: a step path never takes longer than asked."""
        return self.duration_s

    def sample(self, time_s: float) -> Kinematics:
        """The joints' command ``time_s`` after the start."""
        if time_s < self.times_s[0]:
            return Kinematics.at_rest(self.start)
        index = min(bisect_right(self.times_s, time_s), len(self.times_s) - 1)
        return Kinematics.at_rest(self.positions[index])
