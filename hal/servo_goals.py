"""The goals that servos are told: how far ahead of where they are, and how fast to go there."""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Final

from drivers.bus.types import ServoGoal
from hal.joint import Joint

INTERPOLATION_MARGIN: Final = 1.1
"""The servo is told to be a little faster than needed, so that what it lags behind is made up."""
INTERPOLATION_FLOOR_COUNTS_S: Final = 100
SLOWING_S: Final = 0.2
"""A servo that follows behind its goals needs their speed for about so long after they stand."""
CATCH_UP_S: Final = 0.5
"""In about this time a servo that lies behind its goal is to be there."""
BLOCKED_CYCLES: Final = 2
"""So many cycles in a row a joint is further behind than its servo can pull: one false measurement moves no goal."""
UNKNOWN_LEAD_TURNS: Final = 0.12
"""Turns of the shaft by which a servo of unknown stiffness and lag may be behind."""


class ServoGoals:
    """The goals of one component's servos. Each is told how fast to go, so that it moves through the whole period
    instead of leaping to the goal and waiting there.
    """

    def __init__(self, joints: Sequence[Joint]) -> None:
        self._joints = tuple(joints)
        self._leads = {joint.name: _lead_counts(joint) for joint in joints}
        self._behind = dict.fromkeys(self._leads, 0)
        self._goals: dict[str, ServoGoal] = {}

    def hold(self, counts: Mapping[str, int]) -> None:
        """Begin with these goals, which are held, by joint name."""
        self._goals = {name: ServoGoal(count) for name, count in counts.items()}
        self._behind = dict.fromkeys(self._leads, 0)

    def towards(
        self, positions: Iterable[float], period_s: float, measured: Mapping[str, int], withheld: Collection[str]
    ) -> dict[str, ServoGoal]:
        """The next goals on the way to ``positions`` (rad or m, in the order of the joints); none of those withheld.

        None is further from the last than the joint may travel in a period. ``measured``: counts by joint name.
        """
        goals: dict[str, ServoGoal] = {}
        for joint, position in zip(self._joints, positions, strict=True):
            if joint.name in withheld:
                continue
            reach = math.ceil(joint.limits.velocity * period_s / abs(joint.units_per_count))
            held, here = self._goals[joint.name].position_counts, measured.get(joint.name)
            wanted = self._within_pull(joint, joint.counts(position), here, reach)
            # A joint that began outside its limits has a goal there, and must not leap back in.
            counts = min(max(wanted, held - reach), held + reach)
            goals[joint.name] = ServoGoal(counts, self._speed(joint, counts, here, period_s))
        self._goals |= goals
        return goals

    def _within_pull(self, joint: Joint, wanted: int, measured: int | None, reach: int) -> int:
        """A blocked joint's goal no further ahead than a free one's can be: more pulls no harder, and all of it would
        be one leap when the joint comes free.
        """
        turn, lead = joint.model.counts_per_turn, self._leads[joint.name] + reach
        ahead = wanted - measured if measured is not None else 0
        ahead -= round(ahead / turn) * turn  # some report the place within a turn alone
        excess = max(abs(ahead) - lead, 0)
        self._behind[joint.name] = self._behind[joint.name] + 1 if excess else 0
        if self._behind[joint.name] < BLOCKED_CYCLES:
            return wanted
        lower, upper = joint.counts_range()
        return min(max(wanted - int(math.copysign(excess, ahead)), lower), upper)

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


def _lead_counts(joint: Joint) -> int:
    """How far behind its goal a joint may be that nothing holds back: at its velocity limit, at full drive."""
    compliance, speed = joint.compliance, joint.limits.velocity
    if compliance is None:
        return math.ceil(UNKNOWN_LEAD_TURNS * joint.model.counts_per_turn)
    lag = compliance.lag_s * speed + speed**2 / (2.0 * compliance.profile_acceleration)
    return math.ceil((joint.full_effort / compliance.stiffness + lag) / abs(joint.units_per_count))
