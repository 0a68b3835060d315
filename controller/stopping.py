"""How moving joints come to rest when no controller commands them any more."""

from collections.abc import Sequence
from dataclasses import dataclass

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


@dataclass(slots=True)
class _Slowed:
    """Some joints on their way to rest."""

    indices: list[int]
    stop: Stop
    elapsed_s: float = 0.0


class Slowing:
    """Whose controller is deactivated in mid-motion, for whatever reason, comes to rest and is not stopped dead."""

    def __init__(self, limits: Sequence[JointLimits], kinds: Sequence[str], period_s: float) -> None:
        """``limits`` and ``kinds`` of the m command interfaces."""
        self._limits = limits
        self._kinds = kinds
        self._period_s = period_s
        self._claimed = [False] * len(kinds)
        self._slowed: list[_Slowed] = []

    def claim(self, claimed: list[bool], command: FloatArray, previous: FloatArray) -> None:
        """Who is commanded has changed. ``command``, ``previous``: the last two that were sent, shape (m,)."""
        released = [i for i, was in enumerate(self._claimed) if was and not claimed[i]]
        self._claimed = claimed
        if released:
            velocity = (command[released] - previous[released]) / self._period_s
            limits, kinds = [self._limits[i] for i in released], [self._kinds[i] for i in released]
            self._slowed.append(_Slowed(released, Stop(command[released], velocity, limits, kinds)))

    def apply(self, wanted: FloatArray) -> None:
        """Put into ``wanted`` (m,) where those go that come to rest; who is commanded anew is left alone."""
        for slowed in self._slowed:
            slowed.elapsed_s += self._period_s
            for index, value in zip(slowed.indices, slowed.stop.sample(slowed.elapsed_s), strict=True):
                if not self._claimed[index]:
                    wanted[index] = value
        self._slowed = [slowed for slowed in self._slowed if slowed.elapsed_s < slowed.stop.duration_s]

    def busy(self, among: slice) -> bool:
        """Whether one of these is still on its way."""
        return any(among.start <= i < among.stop for slowed in self._slowed for i in slowed.indices)
