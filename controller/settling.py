"""Detect when joints have settled: they have reached their goal or cannot move further."""

from collections.abc import Sequence

import numpy as np

from hal.types import FloatArray, JointLimits, JointState

ARRIVED_SHARE = 0.02
"""Maximum distance from the goal at which a joint counts as having arrived, as a fraction of its range."""
STILL_SHARE = 0.03
"""Maximum velocity of a joint that counts as at rest, as a fraction of its velocity limit."""
STILL_S = 0.1
"""Minimum time at rest short of the goal for a joint to count as stalled (fingers on an object), in seconds."""


class Settling:
    """Detector that reports whether the joints of a controller have settled."""

    def __init__(self, joints: Sequence[str], limits: Sequence[JointLimits], index: Sequence[int]) -> None:
        """Watch the joints that have these ``limits``. ``index`` contains the joints' indices in the hardware's joint
        order."""
        self.settled = True
        self._joints = tuple(joints)
        self._index = list(index)
        self._near = ARRIVED_SHARE * np.array([limit.upper - limit.lower for limit in limits])
        self._slow = STILL_SHARE * np.array([limit.velocity for limit in limits])
        self._still_s = 0.0
        self._fresh = False

    def begin(self) -> None:
        """Start with joints that are held at their current positions."""
        self.settled = True

    def command_changed(self) -> None:
        """Restart the detection, because the joints have just received a new goal."""
        self.settled, self._still_s, self._fresh = False, 0.0, True

    def update(self, goal: FloatArray, command: FloatArray, state: JointState, period_s: float) -> None:
        """Evaluate one cycle. The joints are moving to ``goal`` (n,), and ``command`` (n,) is the current intermediate
        step."""
        # The last known position of an unmeasured joint does not indicate an arrival or a stall.
        if not self.settled and not any(joint in state.faults for joint in self._joints):
            # A state measured before the command does not indicate a stall.
            self.settled = self._arrived(goal, command, state) or (
                not self._fresh and self._stalled(goal, command, state, period_s)
            )
            self._fresh = False

    def _arrived(self, goal: FloatArray, command: FloatArray, state: JointState) -> bool:
        # A joint that reverses may pass its new goal before its command has turned around.
        off = np.maximum(np.abs(state.position[self._index] - goal), np.abs(command - goal))
        return bool((off <= self._near).all())

    def _stalled(self, goal: FloatArray, command: FloatArray, state: JointState, period_s: float) -> bool:
        position = state.position[self._index]
        slow = np.abs(state.velocity[self._index]) <= self._slow
        # When fingers release an object, they stay at rest until the command has moved back out of the object.
        driven = (command - position) * np.sign(goal - position) > 0.0
        still = bool((slow & (driven | (np.abs(position - goal) <= self._near))).all())
        self._still_s = self._still_s + period_s if still else 0.0
        # In the first cycles after a command, joints are at rest because they have not started moving yet.
        return self._still_s > STILL_S
