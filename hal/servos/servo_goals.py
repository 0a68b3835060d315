"""The goals that servos are told: how far ahead of where they are, and how fast to go there."""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Final, NamedTuple, Self

from drivers.bus.types import ServoGoal
from hal.gate import RETURN_SHARE
from hal.joint import Joint
from hal.servos.stall_watch import StallWatch

INTERPOLATION_MARGIN: Final = 1.1
"""The servo is told to be a little faster than needed, so that what it lags behind is made up."""
INTERPOLATION_FLOOR_COUNTS_S: Final = 100
SLOWING_S: Final = 0.2
"""A servo that follows behind its goals needs their speed for about so long after they stand."""
CATCH_UP_S: Final = 0.5
"""In about this time a servo that lies behind its goal is to be there."""
BLOCKED_CYCLES: Final = 2
"""So many cycles in a row a joint is further behind than its servo can pull: one false measurement moves no goal."""
GAINED_S: Final = 0.1
"""A joint's speed is known from the way between two measurements: by now it may be faster by what it gains in this."""
UNKNOWN_LEAD_TURNS: Final = 0.12
"""Turns of the shaft by which a servo of unknown stiffness and lag may be behind."""


class ServoGoals:
    """The goals of one component's servos. Each is told how fast to go, so that it moves through the whole period
    instead of leaping to the goal and waiting there.
    """

    def __init__(self, joints: Sequence[Joint]) -> None:
        self._joints = tuple(joints)
        self._leads = {joint.name: _Lead.of(joint) for joint in joints}
        self._ranges = {joint.name: joint.counts_range() for joint in joints}
        self._behind = {joint.name: 0 for joint in joints}
        self._watch = StallWatch({name: lead.at_rest for name, lead in self._leads.items()})
        self.stalls = self._watch.stalls
        """The joints that press without motion, by name; the drive of those with a torque limit is reduced."""
        self._goals: dict[str, ServoGoal] = {}
        self._measured: dict[str, int] = {}
        """Where the joints were in the cycle before."""

    def hold(self, counts: Mapping[str, int]) -> None:
        """Begin with these goals, which are held, by joint name; other joints keep theirs."""
        self._goals |= {name: ServoGoal(count) for name, count in counts.items()}
        self._behind |= dict.fromkeys(counts, 0)
        self._watch.restart(counts)

    def forget_stalls(self) -> None:
        """The component is inactive: nothing presses any more."""
        self._watch.restart([joint.name for joint in self._joints])

    def towards(
        self,
        positions: Iterable[float],
        period_s: float,
        measured: Mapping[str, int],
        loads: Mapping[str, float],
        withheld: Collection[str],
    ) -> dict[str, ServoGoal]:
        """The next goals on the way to ``positions`` (rad or m, in the order of the joints); none of those withheld.

        None is further than a joint travels in a period. By joint name, ``measured``: counts; ``loads``: drive shares.
        """
        goals: dict[str, ServoGoal] = {}
        for joint, position in zip(self._joints, positions, strict=True):
            if joint.name in withheld:  # without torque it presses against nothing
                self._watch.restart((joint.name,))
                continue
            held, here = self._goals[joint.name].position_counts, measured.get(joint.name)
            lower, upper = self._ranges[joint.name]
            # A joint that began outside its limits has a goal there, and must not leap back in.
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
        """The goal of a joint that is blocked or overloaded, no further ahead than a free one's can be that turns as
        fast: more pulls no harder, and all of it would be one leap when the joint comes free.
        """
        turn = joint.model.counts_per_turn
        way = measured - self._measured.get(joint.name, measured) if measured is not None else 0
        way -= round(way / turn) * turn
        lead = self._leads[joint.name].counts(abs(way) / period_s) + reach
        ahead = wanted - measured if measured is not None else 0
        ahead -= round(ahead / turn) * turn  # some report the place within a turn alone
        excess = max(abs(ahead) - lead, 0)
        self._behind[joint.name] = self._behind[joint.name] + 1 if excess else 0
        if self._behind[joint.name] < BLOCKED_CYCLES:
            return wanted
        return wanted - int(math.copysign(excess, ahead))

    def _speed(self, joint: Joint, counts: int, measured: int | None, period_s: float) -> int:
        """Counts/s.

        As fast as the way from the last goal needs. Where a servo lies behind (it was silent, or
        something was in its way), it catches up in ``CATCH_UP_S``, within the joint's velocity limit.
        """
        held, former = self._goals[joint.name]
        speed = abs(counts - held) / period_s * INTERPOLATION_MARGIN + INTERPOLATION_FLOOR_COUNTS_S
        speed = max(speed, former * (1.0 - min(period_s / SLOWING_S, 1.0)))
        if measured is not None:
            limit = joint.limits.velocity / abs(joint.units_per_count)
            speed = max(speed, min(abs(counts - measured) / CATCH_UP_S, limit))
        return min(round(speed), 32767)


class _Lead(NamedTuple):
    """How far behind its goal a joint may be that nothing holds back, in counts of its servo."""

    at_rest: float
    """At full drive, by the servo's stiffness."""
    lag_s: float = 0.0
    profile_acceleration: float = math.inf
    gained: float = 0.0
    """Counts/s by which it may be faster than it was between the last measurements."""
    fastest: float = math.inf

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
        """At this speed, in counts/s."""
        speed = min(speed + self.gained, self.fastest)
        return math.ceil(self.at_rest + self.lag_s * speed + speed**2 / (2.0 * self.profile_acceleration))
