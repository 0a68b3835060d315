"""Joints come to rest within their limits when their controller goes in mid-motion, instead of stopping dead."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.motion import MotionError
from controller.stopping import Stop
from hal.types import FloatArray, JointLimits

LOG = logging.getLogger("servoloop.controller")

STANDING: Final = 1e-6
"""rad/s, m/s: slower than this is standing."""


@dataclass(slots=True)
class _Stopping:
    """``places``: which interface has which place in the stop's command."""

    places: dict[int, int]
    stop: Stop
    elapsed_s: float = 0.0


class Coasting:
    """Of command interfaces, in the hardware's order. Empty almost always.

    A joint that has lost its controller is nobody's until it stands, whoever wants it next.
    """

    def __init__(self, interfaces: Sequence[str]) -> None:
        self.limits: Mapping[str, JointLimits] = {}
        """By joint; without its limits a joint stops dead."""
        self._split = [name.rpartition("/") for name in interfaces]
        self._stopping: list[_Stopping] = []

    def begin(self, index: Sequence[int], command: FloatArray, velocity: FloatArray) -> None:
        """These have lost their controller; ``command`` (n,) is what all were last told, and its change per second."""
        moving = [i for i in index if self._split[i][0] in self.limits and self._moves(i, command, velocity)]
        if not moving:
            return
        limits = [self.limits[self._split[i][0]] for i in moving]
        kinds = [self._split[i][2] for i in moving]
        try:
            stop = Stop(command[moving], velocity[moving], limits, kinds)
        except MotionError as error:  # from where they are there is no way within the limits
            LOG.error("joints without a controller stop dead: %s", error)
            return
        for former in self._stopping:
            for i in moving:
                former.places.pop(i, None)
        self._stopping.append(_Stopping({i: k for k, i in enumerate(moving)}, stop))

    def _moves(self, i: int, command: FloatArray, velocity: FloatArray) -> bool:
        speed = velocity[i] if self._split[i][2] == "position" else command[i]
        return bool(np.isfinite(command[i]) and abs(speed) > STANDING)

    def holds(self, index: Sequence[int]) -> bool:
        """Whether any of these is still on its way to rest."""
        return any(i in one.places for one in self._stopping for i in index)

    def ends(self, command: FloatArray) -> FloatArray:
        """``command`` (n,), with what is on its way to rest where it will rest."""
        rest = command.copy()
        for one in self._stopping:
            self._put(rest, one, one.stop.duration_s)
        return rest

    def fill(self, wanted: FloatArray, period_s: float) -> None:
        """Their part of ``wanted`` (n,) for the end of the coming period."""
        for one in self._stopping:
            one.elapsed_s += period_s
            self._put(wanted, one, one.elapsed_s)
        self._stopping = [one for one in self._stopping if one.places and one.elapsed_s < one.stop.duration_s]

    @staticmethod
    def _put(values: FloatArray, one: _Stopping, elapsed_s: float) -> None:
        sample = one.stop.sample(elapsed_s)
        for i, k in one.places.items():
            values[i] = sample[k]
