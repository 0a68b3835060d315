"""Motion profile of a servo: a trapezoidal velocity profile that comes to rest at the goal. The units are counts and
seconds.

The duration of the profile is |distance| / speed + speed / acceleration, as in Feetech's examples. If a new goal
arrives during a motion, the profile continues from the current speed. Therefore, goals sent every 50 ms with a suitable
speed result in one smooth motion.
"""

from math import sqrt

UNLIMITED = float("inf")


class MotionProfile:
    """Current set-point of a servo: ``position`` (counts) and ``velocity`` (counts/s)."""

    __slots__ = ("acceleration", "goal", "position", "speed", "velocity")

    def __init__(self) -> None:
        self.position = 0.0
        self.velocity = 0.0
        self.goal = 0.0
        self.speed = UNLIMITED
        """Maximum speed, in counts/s."""
        self.acceleration = UNLIMITED
        """Maximum acceleration, in counts/s^2."""

    @property
    def done(self) -> bool:
        """Whether the set-point is at rest at the goal."""
        return self.velocity == 0.0 and self.position == self.goal

    def restart(self, position: float) -> None:
        """Restart the profile at rest at ``position``."""
        self.position = position
        self.velocity = 0.0

    def step(self, dt_s: float) -> None:
        """Advance by ``dt_s``. The at-rest case is handled first, because most servos are at rest most of the time."""
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
        # A rounding error must not prevent the profile from ending.
        arrived = abs(distance - travelled) < 1e-6
        self.position = self.goal if arrived else self.position + travelled

    def _wanted_speed(self, distance: float, dt_s: float) -> float:
        """Return the maximum speed from which the profile, in steps of ``dt_s``, can still stop at the goal.

        Braking in steps from a speed of n * a * dt covers n(n+1)/2 * a * dt^2 counts. The result is the inverse of this
        formula. In the last step, the result is the speed at which the profile ends exactly at the goal.
        """
        per_step = self.acceleration * dt_s
        reach = distance / dt_s
        if reach <= per_step:
            return min(reach, self.speed)
        brake = per_step * (sqrt(0.25 + 2.0 * reach / per_step) - 0.5)
        return min(brake, self.speed)
