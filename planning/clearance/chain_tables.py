"""Convert the joints of an arm into arrays for compiled code.

Index letters: f for a link, j for a joint of the arm, n for a planned joint. A chain is the list of joints from the
    world to a link.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.polynomial import polynomial

from hal.types import FloatArray
from planning.arm_model import SLIDE, ArmModel
from planning.followers import Follower
from planning.planning_errors import PlanningError


class ChainTables(NamedTuple):
    """Links and joints of an arm. Lengths are in m, angles in rad."""

    parent: Any
    """Index of the parent link (f,), or -1 for the world."""
    link_pos: FloatArray
    """Position of each link relative to its parent (f, 3)."""
    link_mat: FloatArray
    """Rotation matrix of each link relative to its parent (f, 3, 3)."""
    first_joint: Any
    """Index of the first joint of each link (f + 1,)."""
    slides: Any
    """Whether each joint is a slide (j,)."""
    axis: FloatArray
    """Axis of each joint in the link's frame (j, 3)."""
    anchor: FloatArray
    """Point on the axis of each joint in the link's frame (j, 3)."""
    initial: FloatArray
    """Position of each joint in the scene's initial pose (j,)."""
    planned: Any
    """Index of each planned joint among the arm's joints (n,)."""
    follower: Any
    """Index of each mimic joint (m,), leaders first."""
    leader: Any
    """Index of the joint that each mimic joint follows (m,)."""
    coefficients: FloatArray
    """Polynomial coefficients of each mimic joint (m, 5)."""
    steepest: FloatArray
    """Maximum ratio of each mimic joint's speed to its leader's speed (m,)."""
    chain: Any
    """Joints in each link's chain (f, c)."""
    chain_length: Any
    """Number of joints in each link's chain (f,)."""


def chain_tables(arm: ArmModel) -> ChainTables:
    """Return the tables of an arm. Raises PlanningError if the speed of a mimic joint is unbounded."""
    model, bodies = arm.model, arm.bodies
    frame = {body: index for index, body in enumerate(bodies)}
    joints = [joint for body in bodies for joint in _joints(model, body)]
    index = {joint: i for i, joint in enumerate(joints)}
    followers = [follower for follower in arm.followers if follower.joint in index and follower.leader in index]
    counts = [len(_joints(model, body)) for body in bodies]
    chain, length = _chains(arm, frame, index)
    tables = ChainTables(
        parent=np.array([frame.get(int(model.body_parentid[body]), -1) for body in bodies]),
        link_pos=np.array([model.body_pos[body] for body in bodies]),
        link_mat=np.array([_matrix(model.body_quat[body]) for body in bodies]),
        first_joint=np.concatenate(([0], np.cumsum(counts))).astype(np.int64),
        slides=np.array([int(model.jnt_type[joint]) == SLIDE for joint in joints], dtype=np.bool_),
        axis=np.array([model.jnt_axis[joint] for joint in joints]),
        anchor=np.array([model.jnt_pos[joint] for joint in joints]),
        initial=np.array([model.qpos0[model.jnt_qposadr[joint]] for joint in joints]),
        planned=np.array([index[joint] for joint in arm.joint_ids]),
        follower=np.array([index[follower.joint] for follower in followers], dtype=np.int64),
        leader=np.array([index[follower.leader] for follower in followers], dtype=np.int64),
        coefficients=np.array([follower.coefficients for follower in followers]).reshape(-1, 5),
        steepest=np.zeros(len(followers)),
        chain=chain,
        chain_length=length,
    )
    return tables._replace(steepest=_steepest(arm, tables, followers))


def joint_positions(arm: ArmModel) -> FloatArray:
    """Return the current positions of all joints of the arm (j,), in the order of the tables."""
    joints = [joint for body in arm.bodies for joint in _joints(arm.model, body)]
    return np.array([arm.data.qpos[arm.model.jnt_qposadr[joint]] for joint in joints], dtype=float)


def travels(arm: ArmModel, tables: ChainTables) -> FloatArray:
    """Return the maximum distance of each slide from its initial position (j,), in m, with 0 for hinges."""
    return np.where(tables.slides, _farthest(arm, tables), 0.0)


def _farthest(arm: ArmModel, tables: ChainTables) -> FloatArray:
    """Return the maximum distance of each joint from its initial position (j,), in rad or m."""
    farthest = np.abs(joint_positions(arm) - tables.initial)
    for joint, limit in zip(tables.planned, arm.limits, strict=True):
        ends = np.array([limit.lower, limit.upper]) - tables.initial[joint]
        farthest[joint] = max(farthest[joint], float(np.abs(ends).max()))
    for follower, leader, terms in zip(tables.follower, tables.leader, tables.coefficients, strict=True):
        farthest[follower] = _largest(terms, farthest[leader])
    return farthest


def _largest(terms: FloatArray, farthest: float) -> float:
    """Return the maximum absolute value of a polynomial up to a distance from 0, which may be infinite."""
    powers = np.flatnonzero(terms)
    return float(np.abs(terms[powers]) @ farthest**powers)


def _steepest(arm: ArmModel, tables: ChainTables, followers: Sequence[Follower]) -> FloatArray:
    """Return the maximum slope of the polynomial of each mimic joint (m,). Raises PlanningError if it is unbounded."""
    farthest, leaders = _farthest(arm, tables), {follower.joint: follower.leader for follower in followers}
    steepest = np.zeros(len(followers))
    for i, leader in enumerate(tables.leader):
        steepest[i] = _largest(polynomial.polyder(tables.coefficients[i]), farthest[leader])
        if not math.isfinite(steepest[i]):
            joint = followers[i].leader
            while joint in leaders:
                joint = leaders[joint]
            name = arm.model.joint(joint).name
            raise PlanningError(
                "INVALID_ROBOT_STATE",
                f"{name} has no limits, and another joint follows it nonlinearly: set limits for {name}",
            )
    return steepest


def _joints(model: Any, body: int) -> list[int]:
    first = int(model.body_jntadr[body])
    return list(range(first, first + int(model.body_jntnum[body]))) if first >= 0 else []


def _matrix(quaternion: FloatArray) -> FloatArray:
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)


def _chains(arm: ArmModel, frame: dict[int, int], index: dict[int, int]) -> tuple[Any, Any]:
    chains: list[list[int]] = []
    for body in arm.bodies:
        parent = frame.get(int(arm.model.body_parentid[body]))
        before = chains[parent] if parent is not None else []
        chains.append(before + [index[joint] for joint in _joints(arm.model, body)])
    table = np.zeros((len(chains), max(1, *(len(chain) for chain in chains))), dtype=np.int64)
    for row, chain in enumerate(chains):
        table[row, : len(chain)] = chain
    return table, np.array([len(chain) for chain in chains])
