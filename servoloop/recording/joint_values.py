"""The newest values of all joints, put together by name from the messages of one or several publishers."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from hal.types import FloatArray


@dataclass(frozen=True, slots=True)
class JointValues:
    """Arrays (n,) in the order of ``joints``, rad or m, per second, N m or N; NaN for values that were never given."""

    joints: tuple[str, ...] = ()
    position: FloatArray = field(default_factory=lambda: np.empty(0))
    velocity: FloatArray = field(default_factory=lambda: np.empty(0))
    effort: FloatArray = field(default_factory=lambda: np.empty(0))

    def with_message(self, message: Any) -> Self:
        """Return these values with those of a JointState.

        A joint that the message lacks keeps its values. A joint without a finite position keeps its position.
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
    """Return a copy of values (m,) with ``count`` places; the new ones are NaN."""
    return np.append(values, np.full(count - len(values), np.nan))


def _given(values: Sequence[float], count: int) -> FloatArray:
    """The values of a message's field, which may be empty or shorter than its names."""
    return widened(np.asarray(values, dtype=np.float64)[:count], count)
