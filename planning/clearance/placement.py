"""Forward kinematics of an arm and its geoms, in compiled code."""

from math import cos, sin
from typing import Any, NamedTuple

import numpy as np

from hal.types import FloatArray
from planning.clearance.chain_tables import ChainTables
from planning.clearance.compiled import compiled
from planning.clearance.pair_tables import PairTables
from planning.clearance.shapes import KIND, MATRIX, POINT, POSITION


class Placement(NamedTuple):
    """Poses of an arm and of all objects around it, in the world frame. ``place`` overwrites the poses."""

    joint: FloatArray
    """Position of each joint (j,)."""
    link_pos: FloatArray
    """Position of each link (f, 3)."""
    link_mat: FloatArray
    """Rotation matrix of each link (f, 3, 3)."""
    anchor: FloatArray
    """Point on the axis of each joint (j, 3)."""
    axis: FloatArray
    """Axis of each joint (j, 3)."""
    geoms: FloatArray
    """Geoms in the world frame (g, ``shapes.COLUMNS``)."""
    unit_pos: FloatArray
    """Center of the sphere around each unit (u, 3)."""
    rate: FloatArray
    """Scratch space: maximum speed of each unit caused by the joints from each chain index to the end (u, c + 1)."""
    geom_rate: FloatArray
    """Scratch space: maximum speed of each geom caused by the joints from each chain index to the end (g, c + 1). It is
    0 for geoms of the world.
    """
    rated: Any
    """Scratch space: whether ``geom_rate`` is up to date for each unit (u,)."""
    bend: FloatArray
    """Scratch space: rate at which the speed bound of each unit grows (u,)."""
    curve: FloatArray
    """Scratch space: maximum acceleration of each unit (u,)."""
    signed: FloatArray
    """Scratch space: signed speed of each joint (j,)."""
    hints: Any
    """Scratch space: the pairs that limited the last poses and are therefore checked first (2,), with -1 for none."""
    normal: FloatArray
    """Scratch space: unit vector in the direction of the most recent distance (3,)."""


def placement(chains: ChainTables, pairs: PairTables, joint: FloatArray) -> Placement:
    """Return a placement for the given positions of all joints (j,). World objects already have their final poses."""
    links, joints, units = len(chains.parent), len(chains.slides), len(pairs.frame)
    return Placement(
        joint=joint.copy(),
        link_pos=np.zeros((links, 3)),
        link_mat=np.zeros((links, 3, 3)),
        anchor=np.zeros((joints, 3)),
        axis=np.zeros((joints, 3)),
        geoms=pairs.geoms.copy(),
        unit_pos=pairs.unit_pos.copy(),
        rate=np.zeros((units, chains.chain.shape[1] + 1)),
        geom_rate=np.zeros((len(pairs.geoms), chains.chain.shape[1] + 1)),
        rated=np.zeros(units, dtype=np.bool_),
        bend=np.zeros(units),
        curve=np.zeros(units),
        signed=np.zeros(joints),
        hints=np.full(2, -1),
        normal=np.zeros(3),
    )


@compiled
def _turned(m: Any, link: int, v: Any, row: int) -> tuple[float, float, float]:
    """Return row ``row`` of the vectors ``v``, rotated from a link's frame to the world frame."""
    x, y, z = v[row, 0], v[row, 1], v[row, 2]
    return (
        m[link, 0, 0] * x + m[link, 0, 1] * y + m[link, 0, 2] * z,
        m[link, 1, 0] * x + m[link, 1, 1] * y + m[link, 1, 2] * z,
        m[link, 2, 0] * x + m[link, 2, 1] * y + m[link, 2, 2] * z,
    )


@compiled
def _turn(m: Any, link: int, axis: Any, joint: int, angle: float) -> None:
    """Rotate a link about a joint axis."""
    c, s = cos(angle), sin(angle)
    x, y, z, d = axis[joint, 0], axis[joint, 1], axis[joint, 2], 1.0 - c
    for i in range(3):
        a, b, e = m[link, i, 0], m[link, i, 1], m[link, i, 2]
        m[link, i, 0] = a * (c + d * x * x) + b * (d * x * y + s * z) + e * (d * x * z - s * y)
        m[link, i, 1] = a * (d * x * y - s * z) + b * (c + d * y * y) + e * (d * y * z + s * x)
        m[link, i, 2] = a * (d * x * z + s * y) + b * (d * y * z - s * x) + e * (c + d * z * z)


@compiled
def _place_in_parent(chains: ChainTables, position: Any, matrix: Any, link: int) -> None:
    parent, own = chains.parent[link], chains.link_mat
    if parent < 0:
        for i in range(3):
            position[link, i] = chains.link_pos[link, i]
            for k in range(3):
                matrix[link, i, k] = own[link, i, k]
        return
    x, y, z = _turned(matrix, parent, chains.link_pos, link)
    position[link, 0] = position[parent, 0] + x
    position[link, 1] = position[parent, 1] + y
    position[link, 2] = position[parent, 2] + z
    for i in range(3):
        a, b, c = matrix[parent, i, 0], matrix[parent, i, 1], matrix[parent, i, 2]
        for k in range(3):
            matrix[link, i, k] = a * own[link, 0, k] + b * own[link, 1, k] + c * own[link, 2, k]


@compiled
def _move_joint(chains: ChainTables, now: Placement, link: int, joint: int) -> None:
    position, matrix, anchor, axis = now.link_pos, now.link_mat, now.anchor, now.axis
    moved = now.joint[joint] - chains.initial[joint]
    axis[joint, 0], axis[joint, 1], axis[joint, 2] = _turned(matrix, link, chains.axis, joint)
    x, y, z = _turned(matrix, link, chains.anchor, joint)
    anchor[joint, 0], anchor[joint, 1], anchor[joint, 2] = (
        position[link, 0] + x,
        position[link, 1] + y,
        position[link, 2] + z,
    )
    if chains.slides[joint]:
        for i in range(3):
            position[link, i] += axis[joint, i] * moved
        return
    _turn(matrix, link, chains.axis, joint, moved)
    x, y, z = _turned(matrix, link, chains.anchor, joint)
    position[link, 0], position[link, 1], position[link, 2] = (
        anchor[joint, 0] - x,
        anchor[joint, 1] - y,
        anchor[joint, 2] - z,
    )


@compiled
def _place_geoms(pairs: PairTables, now: Placement, unit: int) -> None:
    link, geoms, own = pairs.frame[unit], now.geoms, pairs.geom_mat
    position, matrix = now.link_pos, now.link_mat
    x, y, z = _turned(matrix, link, pairs.unit_pos, unit)
    now.unit_pos[unit, 0] = position[link, 0] + x
    now.unit_pos[unit, 1] = position[link, 1] + y
    now.unit_pos[unit, 2] = position[link, 2] + z
    for geom in range(pairs.first_geom[unit], pairs.first_geom[unit + 1]):
        x, y, z = _turned(matrix, link, pairs.geom_pos, geom)
        geoms[geom, POSITION] = position[link, 0] + x
        geoms[geom, POSITION + 1] = position[link, 1] + y
        geoms[geom, POSITION + 2] = position[link, 2] + z
        if geoms[geom, KIND] == POINT:
            continue  # a rotation does not change a sphere
        for i in range(3):
            a, b, c = matrix[link, i, 0], matrix[link, i, 1], matrix[link, i, 2]
            for k in range(3):
                turned = a * own[geom, 0, k] + b * own[geom, 1, k] + c * own[geom, 2, k]
                geoms[geom, MATRIX + 3 * i + k] = turned


@compiled
def place(chains: ChainTables, pairs: PairTables, now: Placement, positions: Any) -> None:
    """Move the planned joints to the positions (n,)."""
    for i in range(len(chains.planned)):
        now.joint[chains.planned[i]] = positions[i]
    for i in range(len(chains.follower)):
        leader, follower = chains.leader[i], chains.follower[i]
        moved, value = now.joint[leader] - chains.initial[leader], 0.0
        for power in range(4, -1, -1):
            value = value * moved + chains.coefficients[i, power]
        now.joint[follower] = chains.initial[follower] + value
    for link in range(len(chains.parent)):
        _place_in_parent(chains, now.link_pos, now.link_mat, link)
        for joint in range(chains.first_joint[link], chains.first_joint[link + 1]):
            _move_joint(chains, now, link, joint)
    for unit in range(len(pairs.frame)):
        if pairs.frame[unit] >= 0:
            _place_geoms(pairs, now, unit)
