"""Tolerances: how far the joints may be from a goal's path, and from its end."""

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from hal.types import FloatArray, apart

ERASE: Final = -1.0
"""A tolerance that a goal switches off (control_msgs/JointTolerance)."""


@dataclass(frozen=True, slots=True)
class Tolerances:
    """Largest deviations by joint name (rad, m); a joint that is not named has none.

    In a goal 0 stands for the controller's default and ERASE for none at all.
    """

    path: Mapping[str, float] = field(default_factory=dict)
    goal: Mapping[str, float] = field(default_factory=dict)
    goal_time_s: float = 0.0
    """How long after the end the goal tolerance may stay violated; 0: for ever."""
    lag_time_s: Mapping[str, float] = field(default_factory=dict)
    """Time by which a moving joint may lag behind its path, on top of the controller's path tolerance."""


def resolve(asked: Tolerances, default: Tolerances, joints: Sequence[str]) -> Tolerances:
    """The goal's tolerances over the defaults. Raises ValueError, saying why, where a tolerance makes no sense."""
    for kind, named in (("path", asked.path), ("goal", asked.goal)):
        for name in named:
            if name not in joints:
                raise ValueError(f"joint '{name}' specified in goal.{kind}_tolerance does not exist")
    return Tolerances(
        {name: _resolved(asked.path.get(name, 0.0), default.path.get(name, 0.0)) for name in joints},
        {name: _resolved(asked.goal.get(name, 0.0), default.goal.get(name, 0.0)) for name in joints},
        _resolved(asked.goal_time_s, default.goal_time_s),
        {name: default.lag_time_s.get(name, 0.0) for name in joints if not asked.path.get(name)},
    )


def _resolved(asked: float, default: float) -> float:
    if asked == ERASE:
        return 0.0
    if not asked >= 0.0:
        raise ValueError(f"{asked} is no tolerance: more than 0 sets one, 0 is the default and -1 erases it")
    return asked or default


def excess(
    joints: Sequence[str], error: FloatArray, tolerance: Mapping[str, float], unmeasured: Container[str] = ()
) -> str:
    """Which joint's error (n,) exceeds its tolerance most, in words; empty where none does.

    Of a joint that is ``unmeasured`` that is not known.
    """
    found = [
        (abs(off) / allowed, "{} is off by {}, allowed is {}".format(name, *apart(abs(off), allowed)))
        for name, off in zip(joints, error.tolist(), strict=True)
        if 0.0 < (allowed := tolerance.get(name, 0.0)) < abs(off) and name not in unmeasured
    ]
    return max(found)[1] if found else ""
