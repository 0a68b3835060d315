"""What becomes of a goal under way, by its tolerances. Pure; upstream's texts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from controller.goal import ErrorCode, GoalStatus, Tolerances
from controller.motion import Path, stretched
from hal.types import FloatArray

SILENT_CYCLES: Final = 5
"""So many cycles in a row a servo may be silent before the goal is given up."""

DEACTIVATED: Final = "Current goal cancelled during deactivate transition."
PREEMPTED: Final = "Current goal preempted by new incoming action."
PREEMPTED_BY_TOPIC: Final = "Current goal preempted by a trajectory on the topic joint_trajectory."
"""Ours, on purpose: upstream lets the goal succeed with a trajectory that its client never sent."""
TIMED_OUT: Final = "Aborted due to command timeout"


@dataclass(frozen=True, slots=True)
class Verdict:
    """The end of a goal. ``stop``: the joints are still on their way, or not where they should be."""

    status: GoalStatus
    error_code: int
    text: str
    stop: bool = True


def judge(
    joints: Sequence[str], tolerances: Tolerances, path: Path, elapsed_s: float, error: FloatArray
) -> Verdict | None:
    """None while it goes on. ``error`` (n,) is the reference less what was measured."""
    after_end_s = elapsed_s - path.duration_s
    if after_end_s < 0.0:
        if not _exceeds(joints, error, tolerances.path):
            return None
        text = "Aborted due to path tolerance violation"
        return Verdict(GoalStatus.ABORTED, ErrorCode.PATH_TOLERANCE_VIOLATED, text)
    if not _exceeds(joints, error, tolerances.goal):
        return Verdict(GoalStatus.SUCCEEDED, ErrorCode.SUCCESSFUL, _success(path), stop=False)
    if 0.0 < tolerances.goal_time_s < after_end_s:
        text = f"Aborted due to goal_time_tolerance exceeding by {after_end_s:f} seconds"
        # It stands already: the last point goes on being held.
        return Verdict(GoalStatus.ABORTED, ErrorCode.GOAL_TOLERANCE_VIOLATED, text, stop=False)
    return None


def _exceeds(joints: Sequence[str], error: FloatArray, tolerance: Mapping[str, float]) -> bool:
    pairs = zip(joints, error, strict=True)
    return any(0.0 < tolerance.get(name, 0.0) < abs(deviation) for name, deviation in pairs)


def _success(path: Path) -> str:
    text = "Goal successfully reached!"
    if stretched(path):
        text += f" The limits stretched it from {path.asked_s:.2f} s to {path.duration_s:.2f} s."
    return text


class Silence:
    """How long servos have not answered."""

    def __init__(self, joints: Sequence[str]) -> None:
        self._joints = tuple(joints)
        self._cycles: dict[str, int] = {}

    def lasting(self, faults: Mapping[str, str]) -> str | None:
        """One cycle; the faults that have lasted too long, in words, or None."""
        if not faults and not self._cycles:
            return None
        self._cycles = {name: self._cycles.get(name, 0) + 1 for name in self._joints if name in faults}
        return "; ".join(faults[name] for name, count in self._cycles.items() if count >= SILENT_CYCLES) or None
