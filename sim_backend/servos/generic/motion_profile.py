"""The servo's own interpolation: a trapezoid in speed that ends at rest at the goal. Counts, s.

Feetech's examples give its duration as |distance| / speed + speed / acceleration. A new goal on the
way is followed from the present speed, so a goal every 50 ms with a fitting speed makes one motion.
"""

from math import sqrt

UNLIMITED = float("inf")


class MotionProfile:
    """Where the servo wants its shaft now: ``position`` (counts) and ``velocity`` (counts/s)."""

    __slots__ = ("acceleration", "goal", "position", "speed", "velocity")

    def __init__(self) -> None:
        self.position = 0.0
        self.velocity = 0.0
        self.goal = 0.0
        self.speed = UNLIMITED
        """Largest speed, counts/s."""
        self.acceleration = UNLIMITED
        """Largest change of speed, counts/s^2."""

    @property
    def done(self) -> bool:
        """Whether the goal is reached and the profile stands."""
        return self.velocity == 0.0 and self.position == self.goal

    def restart(self, position: float) -> None:
        """Begin again at rest at ``position``."""
        self.position = position
        self.velocity = 0.0

    def step(self, dt_s: float) -> None:
        """Advance by ``dt_s``. Cheap at rest, because most servos stand most of the time."""
        distance = self.goal - self.position
        if distance == 0.0 and self.velocity == 0.0:
            return
        wanted = self._wanted_speed(abs(distance), dt_s)
        if distance < 0.0:
            wanted = -wanted
        change = self.acceleration * dt_s
        velocity = min(max(wanted, self.velocity - change), self.velocity + change)
        travelled = velocity * dt_s
        self.velocity = velocity
        # Arriving is meant exactly, not but for a rounding error.
        arrived = abs(distance - travelled) < 1e-6
        self.position = self.goal if arrived else self.position + travelled

    def _wanted_speed(self, distance: float, dt_s: float) -> float:
        """The largest speed from which the goal can still be met at rest, in steps of ``dt_s``.

        Braking in steps takes n(n+1)/2 * a * dt^2 counts from a speed of n * a * dt; this is its
        inverse, and beyond the last step the speed that ends exactly at the goal.
        """
        per_step = self.acceleration * dt_s
        reach = distance / dt_s
        if reach <= per_step:
            return min(reach, self.speed)
        brake = per_step * (sqrt(0.25 + 2.0 * reach / per_step) - 0.5)
        return min(brake, self.speed)
