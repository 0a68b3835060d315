"""Compute the goal position and goal speed of each servo in a cycle."""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Final, NamedTuple, Self

from drivers.servos.angles import unwrap
from drivers.types import ServoGoal
from hal.gate import RETURN_SHARE
from hal.joint import Joint
from hal.servos.stall_watch import StallWatch

INTERPOLATION_MARGIN: Final = 1.1
"""Factor by which the goal speed exceeds the commanded speed, so that the servo catches up with its lag."""
INTERPOLATION_FLOOR_COUNTS_S: Final = 100
"""Constant part of the goal speed, in counts/s."""
SLOWING_S: Final = 0.2
"""Time in which the goal speed decays after the goals stop changing, in seconds. During this time, the servo still lags
behind the goals.
"""
CATCH_UP_S: Final = 0.5
"""Approximate time that a servo far from its goal takes to reach it."""
BLOCKED_CYCLES: Final = 2
"""Number of consecutive cycles with a large lag after which the goal is limited, so that a single false measurement
does not move it.
"""
GAINED_S: Final = 0.1
"""Age of the measured speed, in seconds. The joint may have accelerated since then."""
UNKNOWN_LEAD_TURNS: Final = 0.12
"""Maximum lag of a servo with unknown stiffness and lag, in turns of the shaft."""


class ServoGoals:
    """Goals of one component's servos.

    Each goal includes a speed, so that the servo moves during the whole period instead of moving fast and then waiting.
    """

    def __init__(self, joints: Sequence[Joint]) -> None:
        self._servos = tuple(_Servo(joint) for joint in joints)
        self._watch = StallWatch({servo.name: servo.lead.at_rest for servo in self._servos})
        self.stalls = self._watch.stalls
        """Joints that push without moving, keyed by name. If a joint has a torque limit, its drive is reduced."""

    def hold(self, counts: Mapping[str, int]) -> None:
        """Set the goals that servos hold after activation, in counts, keyed by joint name.

        Other joints keep their goals.
        """
        for servo in self._servos:
            if servo.name in counts:
                servo.goal, servo.behind = ServoGoal(counts[servo.name]), 0
        self._watch.restart(counts)

    def forget_stalls(self) -> None:
        """Discard all stalls, because the component has become inactive."""
        self._watch.restart([servo.name for servo in self._servos])

    def towards(
        self,
        positions: Iterable[float],
        period_s: float,
        measured: Mapping[str, int],
        loads: Mapping[str, float],
        withheld: Collection[str],
    ) -> dict[str, ServoGoal]:
        """Compute the goals of one cycle, keyed by joint name.

        A goal changes by no more than the distance that the joint may travel in one period. ``positions`` are in rad or
        m, in the order of the joints. ``measured`` holds counts and ``loads`` holds fractions of full drive, both keyed
        by joint name. Joints in ``withheld`` do not receive goals.
        """
        goals: dict[str, ServoGoal] = {}
        watch = self._watch
        for servo, position in zip(self._servos, positions, strict=True):
            name, reading = servo.name, measured.get(servo.name)
            if name in withheld:  # a limp joint cannot push
                watch.restart((name,))
            else:
                here = _as_compared(servo.joint, reading, servo.goal.position_counts)
                command = servo.joint.counts(position)
                eased = watch.goal(servo.joint, command, here, loads.get(name, math.nan), period_s)
                goals[name] = servo.towards(command, eased, here, period_s)
            if reading is not None:
                servo.measured = reading
        if watch.log.events:
            watch.log.flush()
        return goals


class _Servo:
    """Goal of one servo. The joint's constants are computed only once, because every cycle uses them."""

    __slots__ = ("behind", "fastest", "goal", "joint", "lead", "lower", "measured", "name", "turn", "upper")

    def __init__(self, joint: Joint) -> None:
        self.joint, self.name = joint, joint.name
        self.lead = _Lead.of(joint)
        self.lower, self.upper = joint.counts_range()
        self.turn = joint.model.counts_per_turn
        self.fastest = joint.limits.velocity / abs(joint.units_per_count)
        """Velocity limit of the joint, in counts/s."""
        self.behind = 0
        """Number of consecutive cycles in which the goal was too far ahead of the joint."""
        self.goal: ServoGoal
        """Last goal. There is no goal before the joint is activated."""
        self.measured: int | None = None
        """Last measured counts."""

    def towards(self, command: int, eased: int | None, here: int | None, period_s: float) -> ServoGoal:
        """Return the next goal and store it.

        Args:
            command: Commanded position, in counts.
            eased: Goal of a joint with reduced drive, in counts; None if the drive is not reduced.
            here: Measured position, in counts; None if the joint was not measured.
            period_s: Period of the control loop, in seconds.
        """
        held, former = self.goal
        # A joint that was activated outside its limits has a goal outside them and must return slowly.
        share = 1.0 if self.lower <= held <= self.upper else RETURN_SHARE
        joint = self.joint
        reach = math.ceil(share * joint.limits.velocity * period_s / abs(joint.units_per_count))
        wanted = self._within_pull(command, here, reach, period_s) if eased is None else eased
        wanted = min(max(wanted, self.lower), self.upper)
        counts = min(max(wanted, held - reach), held + reach)
        # The speed is computed from the distance to the last goal. A servo that was silent or blocked lags further
        # behind, and catches up in CATCH_UP_S within the joint's velocity limit.
        speed = abs(counts - held) / period_s * INTERPOLATION_MARGIN + INTERPOLATION_FLOOR_COUNTS_S
        speed = max(speed, former * (1.0 - min(period_s / SLOWING_S, 1.0)))
        if here is not None:
            speed = max(speed, min(abs(counts - here) / CATCH_UP_S, self.fastest))
        self.goal = goal = ServoGoal(counts, min(round(speed), 32767))
        return goal

    def _within_pull(self, wanted: int, here: int | None, reach: int, period_s: float) -> int:
        """Limit how far the goal of a blocked or overloaded joint can be ahead of its position.

        The limit is the maximum lag of a joint that moves freely at the measured speed. A goal beyond this limit would
        not increase the torque, but the joint would jump to it as soon as the joint becomes free.
        """
        if here is None:
            self.behind = 0
            return wanted
        travel = here - self.measured if self.measured is not None else 0
        travel -= round(travel / self.turn) * self.turn
        # The difference is not reduced to one turn, because the servo does not move in the shorter direction either.
        ahead = wanted - here
        excess = abs(ahead) - self.lead.counts(abs(travel) / period_s) - reach
        if excess <= 0:
            self.behind = 0
            return wanted
        self.behind += 1
        return wanted if self.behind < BLOCKED_CYCLES else wanted - int(math.copysign(excess, ahead))


def _as_compared(joint: Joint, measured: int | None, goal: int) -> int | None:
    """Return the measured counts in the form in which the servo compares them with its goal.

    A servo with disabled position limits counts turns in its goal, but reports its position within one turn. The turn
    nearest to the goal is the correct one, because the goal of such a servo is never half a turn ahead.
    """
    if measured is None or not joint.seam_inside:
        return measured
    return unwrap(goal, measured, joint.model.counts_per_turn)


class _Lead(NamedTuple):
    """Maximum lag of a free joint behind its goal, in counts."""

    at_rest: float
    """Lag at full drive, from the servo's stiffness."""
    lag_s: float = 0.0
    profile_acceleration: float = math.inf
    gained: float = 0.0
    """Speed that the joint may have gained since the last measurement, in counts/s."""
    fastest: float = math.inf
    """Velocity limit of the joint, in counts/s."""

    @classmethod
    def of(cls, joint: Joint) -> Self:
        compliance, unit = joint.compliance, abs(joint.units_per_count)
        if compliance is None:
            return cls(UNKNOWN_LEAD_TURNS * joint.model.counts_per_turn)
        return cls(
            joint.full_effort / compliance.stiffness / unit,
            compliance.lag_s,
            compliance.profile_acceleration / unit,
            joint.limits.acceleration * GAINED_S / unit,
            joint.limits.velocity / unit,
        )

    def counts(self, speed: float) -> int:
        """Return the maximum lag, in counts, at a speed in counts/s."""
        speed = min(speed + self.gained, self.fastest)
        return math.ceil(self.at_rest + self.lag_s * speed + speed**2 / (2.0 * self.profile_acceleration))
