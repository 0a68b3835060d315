"""Compute the goal position and speed of each servo in a cycle."""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Final, NamedTuple, Self

from calibration.angles import unwrap
from drivers.bus.types import ServoGoal
from hal.gate import RETURN_SHARE
from hal.joint import Joint
from hal.servos.stall_watch import StallWatch

INTERPOLATION_MARGIN: Final = 1.1
"""Factor by which the goal speed exceeds the speed of the command, so that the servo catches up with its lag."""
INTERPOLATION_FLOOR_COUNTS_S: Final = 100
"""Constant part of the goal speed, in counts/s."""
SLOWING_S: Final = 0.2
"""Time in which the goal speed decays after the goals stop, because the servo still lags behind them."""
CATCH_UP_S: Final = 0.5
"""Approximate time in which a servo that is far from its goal reaches it."""
BLOCKED_CYCLES: Final = 2
"""Number of consecutive cycles after which a large lag counts. A single false measurement thus moves no goal."""
GAINED_S: Final = 0.1
"""Age of the measured speed, in seconds. The joint may have accelerated since then."""
UNKNOWN_LEAD_TURNS: Final = 0.12
"""Maximum lag of a servo with unknown stiffness and lag, in turns of the shaft."""


class ServoGoals:
    """Goals of the servos of one component.

    Each goal has a speed, so that the servo moves during the whole period instead of moving fast and waiting.
    """

    def __init__(self, joints: Sequence[Joint]) -> None:
        self._joints = tuple(joints)
        self._leads = {joint.name: _Lead.of(joint) for joint in joints}
        self._ranges = {joint.name: joint.counts_range() for joint in joints}
        self._behind = {joint.name: 0 for joint in joints}
        self._watch = StallWatch({name: lead.at_rest for name, lead in self._leads.items()})
        self.stalls = self._watch.stalls
        """Joints that press without motion, by name. The drive of joints with a torque limit is reduced."""
        self._goals: dict[str, ServoGoal] = {}
        self._measured: dict[str, int] = {}
        """Measured counts of the previous cycle, by joint name."""

    def hold(self, counts: Mapping[str, int]) -> None:
        """Set the goals (counts by joint name) that the servos hold after activation. Other joints keep their goals."""
        self._goals |= {name: ServoGoal(count) for name, count in counts.items()}
        self._behind |= dict.fromkeys(counts, 0)
        self._watch.restart(counts)

    def forget_stalls(self) -> None:
        """Discard all stalls, because the component has become inactive."""
        self._watch.restart([joint.name for joint in self._joints])

    def towards(
        self,
        positions: Iterable[float],
        period_s: float,
        measured: Mapping[str, int],
        loads: Mapping[str, float],
        withheld: Collection[str],
    ) -> dict[str, ServoGoal]:
        """Compute the goals of one cycle, by joint name. A goal changes by at most the joint's travel in one period.

        ``positions`` are in rad or m, in the order of the joints. ``measured`` has counts and ``loads`` has shares of
        full drive, both by joint name. Joints in ``withheld`` get no goal.
        """
        goals: dict[str, ServoGoal] = {}
        for joint, position in zip(self._joints, positions, strict=True):
            if joint.name in withheld:  # a joint without torque cannot press
                self._watch.restart((joint.name,))
                continue
            held = self._goals[joint.name].position_counts
            here = _as_compared(joint, measured.get(joint.name), held)
            lower, upper = self._ranges[joint.name]
            # A joint that was activated outside its limits has its goal there and must return slowly.
            share = 1.0 if lower <= held <= upper else RETURN_SHARE
            reach = math.ceil(share * joint.limits.velocity * period_s / abs(joint.units_per_count))
            command = joint.counts(position)
            eased = self._watch.goal(joint, command, here, loads.get(joint.name, math.nan), period_s)
            wanted = self._within_pull(joint, command, here, reach, period_s) if eased is None else eased
            wanted = min(max(wanted, lower), upper)
            counts = min(max(wanted, held - reach), held + reach)
            goals[joint.name] = ServoGoal(counts, self._speed(joint, counts, here, period_s))
        if self._watch.log.events:
            self._watch.log.flush()
        self._goals |= goals
        self._measured |= measured
        return goals

    def _within_pull(self, joint: Joint, wanted: int, measured: int | None, reach: int, period_s: float) -> int:
        """Limit how far the goal of a blocked or overloaded joint is ahead of its position.

        The limit is the largest lag of a free joint at this speed. A goal further ahead would not increase the torque,
        and the joint would jump when it comes free.
        """
        turn = joint.model.counts_per_turn
        travel = measured - self._measured.get(joint.name, measured) if measured is not None else 0
        travel -= round(travel / turn) * turn
        lead = self._leads[joint.name].counts(abs(travel) / period_s) + reach
        # The servo compares the same counts: it does not take the shorter way around either.
        ahead = wanted - measured if measured is not None else 0
        excess = max(abs(ahead) - lead, 0)
        self._behind[joint.name] = self._behind[joint.name] + 1 if excess else 0
        if self._behind[joint.name] < BLOCKED_CYCLES:
            return wanted
        return wanted - int(math.copysign(excess, ahead))

    def _speed(self, joint: Joint, counts: int, measured: int | None, period_s: float) -> int:
        """Return the goal speed in counts/s.

        It follows from the distance to the last goal. A servo that was silent or blocked is further behind, and catches
        up in ``CATCH_UP_S`` within the joint's velocity limit.
        """
        held, former = self._goals[joint.name]
        speed = abs(counts - held) / period_s * INTERPOLATION_MARGIN + INTERPOLATION_FLOOR_COUNTS_S
        speed = max(speed, former * (1.0 - min(period_s / SLOWING_S, 1.0)))
        if measured is not None:
            limit = joint.limits.velocity / abs(joint.units_per_count)
            speed = max(speed, min(abs(counts - measured) / CATCH_UP_S, limit))
        return min(round(speed), 32767)


def _as_compared(joint: Joint, measured: int | None, goal: int) -> int | None:
    """Return the measured counts as the servo compares them with its goal.

    A servo with disabled position limits counts turns in its goal, but reports its position within one turn. The turn
    nearest to the goal is the right turn, because the goal of such a servo is never half a turn ahead.
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
        """Return the maximum lag at a speed in counts/s."""
        speed = min(speed + self.gained, self.fastest)
        return math.ceil(self.at_rest + self.lag_s * speed + speed**2 / (2.0 * self.profile_acceleration))
