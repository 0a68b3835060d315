"""The ramp-in: from where a follower stands to where its leader is, slowly, also while the leader moves."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from ruckig import InputParameter, OutputParameter, Result, Ruckig, Synchronization

from hal.types import FloatArray, JointLimits

SHARE: Final = 0.25
"""Of each joint's velocity limit."""
JOINED: Final = 0.01
"""Within this share of its range a joint counts as being where its leader is."""


class RampIn:
    """One ramp, computed online by ruckig. Arrays (n,) in rad or m."""

    def __init__(self, command: FloatArray, limits: Sequence[JointLimits], period_s: float) -> None:
        """``command``: where the follower stands, at rest."""
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
        """Go on towards the target for one period. Raises ArithmeticError where ruckig finds no way."""
        self._task.target_position = target.tolist()
        result = self._ruckig.update(self._task, self._output)
        if result not in (Result.Working, Result.Finished):
            raise ArithmeticError(f"no way to the leader's pose ({result.name})")
        self._output.pass_to_input(self._task)
        self.command = np.array(self._output.new_position)

    def joined(self, target: FloatArray) -> bool:
        """Whether every joint is where its leader is."""
        return bool((np.abs(target - self.command) <= self._near).all())
