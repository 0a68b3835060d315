"""Combine the joint states of one or more publishers into the latest values of all joints."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from hal.types import FloatArray


@dataclass(frozen=True, slots=True)
class JointValues:
    """Latest values of all joints: arrays (n,) in the order of ``joints``, with NaN for values that were never
    received.

    Units are rad or m, rad/s or m/s, and N m or N.
    """

    joints: tuple[str, ...] = ()
    position: FloatArray = field(default_factory=lambda: np.empty(0))
    velocity: FloatArray = field(default_factory=lambda: np.empty(0))
    effort: FloatArray = field(default_factory=lambda: np.empty(0))

    def with_message(self, message: Any) -> Self:
        """Return these values, updated with a JointState message.

        Joints missing from the message keep their values. Joints without a finite position keep their position.
        """
        joints = tuple(dict.fromkeys((*self.joints, *message.name)))
        places = [joints.index(name) for name in message.name]
        position = widened(self.position, len(joints))
        given = _given(message.position, len(places))
        position[places] = np.where(np.isfinite(given), given, position[places])
        velocity, effort = widened(self.velocity, len(joints)), widened(self.effort, len(joints))
        velocity[places] = _given(message.velocity, len(places))
        effort[places] = _given(message.effort, len(places))
        return type(self)(joints, position, velocity, effort)


def widened(values: FloatArray, count: int) -> FloatArray:
    """Return a copy of ``values`` (m,) extended to length ``count`` with NaN."""
    return np.append(values, np.full(count - len(values), np.nan))


def _given(values: Sequence[float], count: int) -> FloatArray:
    """Return the values of a message field, extended with NaN if there are fewer values than names."""
    return widened(np.asarray(values, dtype=np.float64)[:count], count)
