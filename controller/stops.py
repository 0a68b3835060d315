"""Joints come to rest within their limits when their controller goes in mid-motion, instead of stopping dead."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.motion import Kinematics, Motion, MotionError, plan_stop
from hal.types import FloatArray, JointLimits

LOG = logging.getLogger("servoloop.controller")

STANDING: Final = 1e-6
"""rad/s, m/s: slower than this is standing."""


class StopMotion:
    """A stop brings command interfaces to rest, as fast as acceleration and jerk allow.

    Velocities are asked to be 0, which the safety gate brings about within the acceleration; efforts end at once.
    """

    def __init__(
        self, command: FloatArray, velocity: FloatArray, limits: Sequence[JointLimits], kinds: Sequence[str]
    ) -> None:
        """``command`` is the last one of the hardware, with its change per second ``velocity``, shape (k,)."""
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
class _Stopping:
    """One stop under way; ``places``: the place of each interface in the stop's command."""

    places: dict[int, int]
    stop: StopMotion
    elapsed_s: float = 0.0


class DecelerationStops:
    """The stops of joints that have lost their controller in mid-motion: no controller has them until they stand."""

    def __init__(self, interfaces: Sequence[str], limits: Mapping[str, JointLimits]) -> None:
        """``limits`` by joint; without its limits a joint stops dead."""
        self._limits = limits
        self._split = [name.rpartition("/") for name in interfaces]
        self.moving: list[_Stopping] = []
        """The stops under way; almost always there are none, and then nothing here is called in a cycle."""

    def begin(self, index: Sequence[int], command: FloatArray, velocity: FloatArray) -> None:
        """These have lost their controller; ``command`` (n,) is the last command of all, and its change per second."""
        moving = [i for i in index if self._split[i][0] in self._limits and self._moves(i, command, velocity)]
        if not moving:
            return
        limits = [self._limits[self._split[i][0]] for i in moving]
        kinds = [self._split[i][2] for i in moving]
        try:
            stop = StopMotion(command[moving], velocity[moving], limits, kinds)
        except MotionError as error:  # from where they are there is no way within the limits
            LOG.error("joints without a controller stop dead: %s", error)
            return
        for former in self.moving:
            for i in moving:
                former.places.pop(i, None)
        self.moving.append(_Stopping({i: k for k, i in enumerate(moving)}, stop))

    def _moves(self, i: int, command: FloatArray, velocity: FloatArray) -> bool:
        speed = velocity[i] if self._split[i][2] == "position" else command[i]
        return bool(np.isfinite(command[i]) and abs(speed) > STANDING)

    def holds(self, index: Sequence[int]) -> bool:
        """Whether any of these is still on its way to rest."""
        return any(i in one.places for one in self.moving for i in index)

    def ends(self, command: FloatArray) -> FloatArray:
        """``command`` (n,), with joints on their way to rest where they will rest."""
        rest = command.copy()
        for one in self.moving:
            self._put(rest, one, one.stop.duration_s)
        return rest

    def fill(self, wanted: FloatArray, period_s: float) -> None:
        """Their part of ``wanted`` (n,) for the end of the coming period."""
        for one in self.moving:
            one.elapsed_s += period_s
            self._put(wanted, one, one.elapsed_s)
        self.moving = [one for one in self.moving if one.places and one.elapsed_s < one.stop.duration_s]

    @staticmethod
    def _put(values: FloatArray, one: _Stopping, elapsed_s: float) -> None:
        sample = one.stop.sample(elapsed_s)
        for i, k in one.places.items():
            values[i] = sample[k]
