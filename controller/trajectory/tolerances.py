"""Check the joints' distance from the path, and their distance from the goal at the end, against tolerances."""

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from hal.types import FloatArray, apart

ERASE: Final = -1.0
"""Value with which a goal disables a tolerance (see control_msgs/JointTolerance)."""


@dataclass(frozen=True, slots=True)
class Tolerances:
    """Maximum deviations in rad or m, keyed by joint name. A joint without an entry has no tolerance.

    In a goal, 0 means the controller's default, and ERASE means no tolerance.
    """

    path: Mapping[str, float] = field(default_factory=dict)
    goal: Mapping[str, float] = field(default_factory=dict)
    goal_time_s: float = 0.0
    """Maximum time to reach the goal tolerance after the path ends, in seconds; 0 means no limit."""
    lag_time_s: Mapping[str, float] = field(default_factory=dict)
    """Time by which a moving joint may lag behind its path, in addition to the path tolerance, in seconds."""


def resolve(asked: Tolerances, default: Tolerances, joints: Sequence[str]) -> Tolerances:
    """Combine the tolerances of a goal with the defaults. Raises ValueError if a tolerance is invalid."""
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
        raise ValueError(f"a tolerance must be positive, 0 for the default or -1 for none, not {asked}")
    return asked or default


def excess(
    joints: Sequence[str], error: FloatArray, tolerance: Mapping[str, float], unmeasured: Container[str] = ()
) -> str:
    """Describe the joint whose error (n,) exceeds its tolerance the most, or return an empty string.

    Joints in ``unmeasured`` are ignored.
    """
    found = [
        (abs(off) / allowed, "{} is off by {}, allowed is {}".format(name, *apart(abs(off), allowed)))
        for name, off in zip(joints, error.tolist(), strict=True)
        if 0.0 < (allowed := tolerance.get(name, 0.0)) < abs(off) and name not in unmeasured
    ]
    return max(found)[1] if found else ""
