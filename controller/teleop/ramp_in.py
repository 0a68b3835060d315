"""Move a follower slowly from its own position to the position of its leader, even if the leader moves."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from ruckig import InputParameter, OutputParameter, Result, Ruckig, Synchronization

from hal.types import FloatArray, JointLimits

SHARE: Final = 0.25
"""Fraction of each joint's velocity limit that the ramp uses."""
JOINED: Final = 0.01
"""Maximum distance from its leader at which a joint counts as joined, as a fraction of the joint's range."""


class RampIn:
    """A ramp to the leader's position, computed online by ruckig. Arrays have shape (n,), in rad or m."""

    def __init__(self, command: FloatArray, limits: Sequence[JointLimits], period_s: float) -> None:
        """Start at ``command``, where the follower is at rest."""
        count = len(limits)
        self._ruckig = Ruckig(count, period_s)
        self._task, self._output = InputParameter(count), OutputParameter(count)
        self._task.current_position = command.tolist()
        self._task.max_velocity = [SHARE * limit.velocity for limit in limits]
        self._task.max_acceleration = [limit.acceleration for limit in limits]
        self._task.max_jerk = [limit.jerk for limit in limits]
        self._task.synchronization = Synchronization.No
        self._near = JOINED * np.array([limit.upper - limit.lower for limit in limits])
        self.command = command

    def step(self, target: FloatArray) -> None:
        """Move toward the target for one period. Raises ArithmeticError if ruckig cannot find a motion."""
        self._task.target_position = target.tolist()
        result = self._ruckig.update(self._task, self._output)
        if result not in (Result.Working, Result.Finished):
            raise ArithmeticError(f"no motion to the leader's pose was found ({result.name})")
        self._output.pass_to_input(self._task)
        self.command = np.array(self._output.new_position)

    def joined(self, target: FloatArray) -> bool:
        """Return whether every joint has reached the position of its leader."""
        return bool((np.abs(target - self.command) <= self._near).all())
