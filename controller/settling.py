"""Joints have settled when they have arrived at their command, or can go no further."""

from collections.abc import Sequence

import numpy as np

from hal.types import FloatArray, JointLimits, JointState

ARRIVED_SHARE = 0.02
"""Share of a joint's range within which it has arrived."""
STILL_SHARE = 0.03
"""Share of a joint's velocity limit below which it stands still."""
STILL_S = 0.1
"""So long a joint must stand still short of its goal to count as stalled (fingers on an object)."""


class Settling:
    """Settling watches joints: those at ``index`` in the hardware's order, with their ``limits``."""

    def __init__(self, joints: Sequence[str], limits: Sequence[JointLimits], index: Sequence[int]) -> None:
        self.settled = True
        self._joints = tuple(joints)
        self._index = list(index)
        self._near = ARRIVED_SHARE * np.array([limit.upper - limit.lower for limit in limits])
        self._slow = STILL_SHARE * np.array([limit.velocity for limit in limits])
        self._still_s = 0.0
        self._fresh = False

    def begin(self) -> None:
        """The joints are held where they are."""
        self.settled = True

    def command_changed(self) -> None:
        """The joints have just been commanded to be elsewhere."""
        self.settled, self._still_s, self._fresh = False, 0.0, True

    def look(self, goal: FloatArray, command: FloatArray, state: JointState, period_s: float) -> None:
        """Look at one cycle. The joints are to come to ``goal`` (n,); ``command`` (n,) is on its way there."""
        # Last known values say nothing of now: joints that are not measured have neither arrived nor stalled.
        if not self.settled and not any(joint in state.faults for joint in self._joints):
            # A state that is older than the command says nothing of a stall.
            self.settled = self._arrived(goal, state) or (
                not self._fresh and self._stalled(goal, command, state, period_s)
            )
            self._fresh = False

    def _arrived(self, goal: FloatArray, state: JointState) -> bool:
        return bool((np.abs(state.position[self._index] - goal) <= self._near).all())

    def _stalled(self, goal: FloatArray, command: FloatArray, state: JointState, period_s: float) -> bool:
        position = state.position[self._index]
        slow = np.abs(state.velocity[self._index]) <= self._slow
        # Fingers that held something stand until the command has come back to them from within it.
        driven = (command - position) * np.sign(goal - position) > 0.0
        still = bool((slow & (driven | (np.abs(position - goal) <= self._near))).all())
        self._still_s = self._still_s + period_s if still else 0.0
        # The first cycles after a command are still because nothing has begun to move yet.
        return self._still_s > STILL_S
