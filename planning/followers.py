"""Mimic joints of a scene. A mimic joint follows another joint, its leader."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from hal.types import FloatArray
from planning.planning_errors import PlanningError


class Follower(NamedTuple):
    """Coupling of a mimic joint, from a joint equality constraint in the scene."""

    joint: int
    """ID of the mimic joint in the model."""
    leader: int
    """ID of the joint that the mimic joint follows."""
    coefficients: FloatArray
    """Polynomial coefficients (5,), lowest power first. The polynomial converts the leader's offset from its initial
    position to the follower's offset.
    """


def followers(model: Any) -> tuple[Follower, ...]:
    """Return the mimic joints of a model, leaders first.

    Raises PlanningError if they depend on each other in a loop.
    """
    found = []
    for row in range(model.neq):
        is_joint = int(model.eq_type[row]) == int(mujoco.mjtEq.mjEQ_JOINT)
        if is_joint and model.eq_active0[row] and int(model.eq_obj2id[row]) >= 0:
            coefficients = np.array(model.eq_data[row, :5])
            found.append(Follower(int(model.eq_obj1id[row]), int(model.eq_obj2id[row]), coefficients))
    return _leaders_first(found)


def followers_between(model: Any, leaders: Iterable[int], ends: Iterable[int]) -> tuple[Follower, ...]:
    """Return the mimic joints through which ``leaders`` move ``ends``, leaders first.

    Args:
        model: The MuJoCo model (mujoco.MjModel).
        leaders: IDs of the joints that are moved.
        ends: IDs of the joints of interest.
    """
    moved, wanted, found = set(leaders), set(ends), list[Follower]()
    for follower in followers(model):
        if follower.leader in moved:
            moved.add(follower.joint)
            found.append(follower)
    for follower in reversed(found):
        if follower.joint in wanted:
            wanted.add(follower.leader)
    return tuple(follower for follower in found if follower.joint in wanted)


def _leaders_first(followers: Sequence[Follower]) -> tuple[Follower, ...]:
    ordered: list[Follower] = []
    waiting = list(followers)
    while waiting:
        open_joints = {follower.joint for follower in waiting}
        ready = [follower for follower in waiting if follower.leader not in open_joints]
        if not ready:
            raise PlanningError("INVALID_ROBOT_STATE", "mimic joints of the scene depend on each other in a loop")
        ordered += ready
        waiting = [follower for follower in waiting if follower.leader in open_joints]
    return tuple(ordered)
