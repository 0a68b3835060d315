"""Tolerances decide how a goal under way ends. Pure; the texts are upstream's."""

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from controller.motion import Path, stretched
from controller.trajectory.goal import ERASE, ErrorCode, GoalStatus, Tolerances
from hal.types import FloatArray

DEACTIVATED: Final = "Current goal cancelled during deactivate transition."
PREEMPTED: Final = "Current goal preempted by new incoming action."
PREEMPTED_BY_TOPIC: Final = "Current goal preempted by a trajectory on the topic joint_trajectory."
"""Ours, on purpose: upstream lets the goal succeed with a trajectory that its client never sent."""
TIMED_OUT: Final = "Aborted due to command timeout"


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
    )


def _resolved(asked: float, default: float) -> float:
    if asked == ERASE:
        return 0.0
    if not asked >= 0.0:
        raise ValueError(f"{asked} is no tolerance: more than 0 sets one, 0 is the default and -1 erases it")
    return asked or default


@dataclass(frozen=True, slots=True)
class GoalResult:
    """The end of a goal. ``stop``: the joints are still on their way, or not where they should be."""

    status: GoalStatus
    error_code: int
    text: str
    stop: bool = True


def goal_result(
    joints: Sequence[str],
    tolerances: Tolerances,
    path: Path,
    elapsed_s: float,
    error: FloatArray,
    unmeasured: Container[str] = (),
) -> GoalResult | None:
    """The goal's result, or None while the goal goes on. ``error`` (n,) is the reference less what was measured last.

    A joint that is ``unmeasured`` in this cycle has not left the path tolerance, as far as is known.
    """
    after_end_s = elapsed_s - path.duration_s
    if after_end_s < 0.0:
        measured = {name: limit for name, limit in tolerances.path.items() if name not in unmeasured}
        if not _exceeds(joints, error, measured):
            return None
        text = "Aborted due to path tolerance violation"
        return GoalResult(GoalStatus.ABORTED, ErrorCode.PATH_TOLERANCE_VIOLATED, text)
    if not _exceeds(joints, error, tolerances.goal):
        return GoalResult(GoalStatus.SUCCEEDED, ErrorCode.SUCCESSFUL, _success(path), stop=False)
    if 0.0 < tolerances.goal_time_s < after_end_s:
        text = f"Aborted due to goal_time_tolerance exceeding by {after_end_s:f} seconds"
        # It stands already: the last point goes on being held.
        return GoalResult(GoalStatus.ABORTED, ErrorCode.GOAL_TOLERANCE_VIOLATED, text, stop=False)
    return None


def _exceeds(joints: Sequence[str], error: FloatArray, tolerance: Mapping[str, float]) -> bool:
    pairs = zip(joints, error, strict=True)
    return any(0.0 < tolerance.get(name, 0.0) < abs(deviation) for name, deviation in pairs)


def _success(path: Path) -> str:
    text = "Goal successfully reached!"
    if stretched(path):
        text += f" The limits stretched it from {path.asked_s:.2f} s to {path.duration_s:.2f} s."
    return text
