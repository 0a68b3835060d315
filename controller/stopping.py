"""How moving joints come to rest when no controller commands them any more."""

from collections.abc import Sequence

import numpy as np

from controller.motion import Kinematics, Motion, plan_stop
from hal.types import FloatArray, JointLimits


class Stop:
    """The way of command interfaces to rest, as fast as acceleration and jerk allow.

    Velocities are asked to be 0, which the safety gate brings about within the acceleration; efforts end at once.
    """

    def __init__(
        self, command: FloatArray, velocity: FloatArray, limits: Sequence[JointLimits], kinds: Sequence[str]
    ) -> None:
        """``command`` as the hardware was last told and its change per second ``velocity``, shape (k,)."""
        positions = np.array([kind == "position" for kind in kinds], dtype=bool)
        self._command = np.where(positions, command, 0.0)
        self._moved = np.flatnonzero(positions & np.isfinite(command) & np.isfinite(velocity)).tolist()
        self._motion = self._plan(velocity, [limits[i] for i in self._moved]) if self._moved else None
        ramps = [abs(command[i]) / limits[i].acceleration for i, kind in enumerate(kinds) if kind == "velocity"]
        self.duration_s = max([self._motion.duration_s if self._motion else 0.0, *ramps])
        """Until all stands."""

    def _plan(self, velocity: FloatArray, limits: Sequence[JointLimits]) -> Motion:
        bound = np.array([limit.velocity for limit in limits])
        speed = np.clip(velocity[self._moved], -bound, bound)
        return plan_stop(Kinematics(self._command[self._moved], speed, np.zeros_like(speed)), limits)

    def sample(self, elapsed_s: float) -> FloatArray:
        """The command of shape (k,) so long after the beginning; a position that was unknown stays unknown."""
        command = self._command.copy()
        if self._motion is not None:
            command[self._moved] = self._motion.sample(elapsed_s).position
        return command
