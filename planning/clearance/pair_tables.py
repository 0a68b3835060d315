"""Convert the links and objects that can touch each other into arrays for compiled code.

Index letters: g for a geom, u for a unit (a link, or a shape of an object), p for a pair of units.
"""

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from hal.types import FloatArray
from planning.arm_model import ArmModel, pair
from planning.clearance import shapes
from planning.clearance.chain_tables import ChainTables, travels
from planning.clearance.geometry_tables import WORLD, Geom, GeomGroup, arm_units, attached_units, world_units
from planning.planning_errors import PlanningError
from planning.scene import Scene

LONGEST_M: Final = 1e6
"""Radius that represents an infinite radius, in m."""


class PairTables(NamedTuple):
    """Geoms, units and pairs of units. Lengths in m."""

    geoms: FloatArray
    """Geoms (g, ``shapes.COLUMNS``). Geoms of the world already have their final poses."""
    geom_pos: FloatArray
    """Position of each geom relative to its link or the world (g, 3)."""
    geom_mat: FloatArray
    """Rotation matrix of each geom relative to its link or the world (g, 3, 3)."""
    vertices: FloatArray
    """Vertices of all hulls (v, 3)."""
    frame: Any
    """Link index of each unit (u,), or -1 for the world."""
    first_geom: Any
    """Index of the first geom of each unit (u + 1,)."""
    unit_pos: FloatArray
    """Center of the sphere around each unit, relative to its link or the world (u, 3)."""
    unit_radius: FloatArray
    """Radius of the sphere around each unit (u,)."""
    unit_swing: FloatArray
    """Distance from the sphere's center to the farthest point that a rotation moves (u,)."""
    lever: FloatArray
    """Maximum distance of each unit from the axis of each joint in its chain (u, c), with 1 for a slide."""
    one: Any
    """First unit of each pair (p,), which is never part of the world."""
    other: Any
    """Second unit of each pair (p,)."""
    common: Any
    """Number of joints that the two chains of each pair share, counted from the world (p,)."""
    extra: FloatArray
    """Scratch space: amount by which the padding of each pair exceeds the padding between links (p,)."""


def pair_tables(arm: ArmModel, scene: Scene, chains: ChainTables) -> tuple[PairTables, tuple[str, ...]]:
    """Return the tables for an arm in a scene, and the name of each unit.

    A pair is omitted if no planned joint changes its distance, or if its two units may touch.

    Raises PlanningError if an object has the same name as a link.
    """
    for name in (*scene.objects, *scene.attached):
        if name in arm.links:
            raise PlanningError("INVALID_OBJECT_NAME", f'object "{name}" has the name of a link: rename the object')
    units = [*arm_units(arm), *attached_units(arm, scene), *world_units(arm, scene)]
    geoms = [geom for unit in units for geom in unit.geoms]
    spheres = [unit.sphere() for unit in units]
    vertices, travel = [geom.vertices_m for geom in geoms], travels(arm, chains)
    one, other, common = _pairs(arm, scene, units, chains)
    tables = PairTables(
        geoms=_rows(geoms),
        geom_pos=np.array([geom.pose.position_m for geom in geoms]).reshape(-1, 3),
        geom_mat=np.array([geom.pose.matrix for geom in geoms]).reshape(-1, 3, 3),
        vertices=np.concatenate([np.zeros((0, 3)), *vertices]),
        frame=np.array([unit.frame for unit in units], dtype=np.int64),
        first_geom=_starts([len(unit.geoms) for unit in units]),
        unit_pos=np.array([center for center, _ in spheres]).reshape(-1, 3),
        unit_radius=np.array([min(radius, LONGEST_M) for _, radius in spheres], dtype=float),
        unit_swing=np.array(
            [min(unit.swing_m(center), LONGEST_M) for unit, (center, _) in zip(units, spheres, strict=True)]
        ),
        lever=np.array([_levers(unit, chains, travel) for unit in units]),
        one=one,
        other=other,
        common=common,
        extra=np.zeros(len(one)),
    )
    return tables, tuple(unit.name for unit in units)


def _rows(geoms: Sequence[Geom]) -> FloatArray:
    ends = _starts([len(geom.vertices_m) for geom in geoms])
    rows = np.zeros((len(geoms), shapes.COLUMNS))
    for row, geom, first, end in zip(rows, geoms, ends, ends[1:], strict=False):
        row[shapes.KIND] = geom.kind
        row[shapes.SIZE : shapes.SIZE + 3] = geom.size
        row[shapes.MARGIN] = geom.margin_m
        row[shapes.RADIUS] = min(geom.radius_m, LONGEST_M)
        row[shapes.POSITION : shapes.POSITION + 3] = geom.pose.position_m
        row[shapes.MATRIX : shapes.MATRIX + 9] = geom.pose.matrix.ravel()
        row[shapes.SWING] = min(geom.swing_m, LONGEST_M)
        row[shapes.FIRST_VERTEX], row[shapes.END_VERTEX] = first, end
    return rows


def _starts(counts: Sequence[int]) -> Any:
    return np.concatenate(([0], np.cumsum(np.array(counts, dtype=np.int64)))).astype(np.int64)


def _chain(chains: ChainTables, frame: int) -> list[int]:
    return [] if frame == WORLD else chains.chain[frame, : chains.chain_length[frame]].tolist()


def _pairs(arm: ArmModel, scene: Scene, units: Sequence[GeomGroup], chains: ChainTables) -> tuple[Any, Any, Any]:
    moving = {int(joint) for joint in chains.planned}
    for joint, leader in zip(chains.follower.tolist(), chains.leader.tolist(), strict=True):  # leaders come first
        if leader in moving:
            moving.add(joint)
    allowed = scene.allowed | arm.adjacent()
    paths = [_chain(chains, unit.frame) for unit in units]
    found: list[tuple[int, int, int]] = []
    for i, one in enumerate(units):
        if one.frame == WORLD:
            break  # the units of the world come last
        for j in range(i + 1, len(units)):
            other, first, second = units[j], paths[i], paths[j]
            common = sum(1 for a, b in zip(first, second, strict=False) if a == b)
            if moving.isdisjoint(first[common:]) and moving.isdisjoint(second[common:]):
                continue
            touches = other.name in one.touch_links or one.name in other.touch_links or one.name == other.name
            if not touches and pair(one.name, other.name) not in allowed:
                found.append((i, j, common))
    one_table, other_table, common_table = np.array(found, dtype=np.int64).reshape(-1, 3).T.copy()
    return one_table, other_table, common_table


def _levers(unit: GeomGroup, chains: ChainTables, travel: FloatArray) -> FloatArray:
    """Return the maximum distance of a unit from the axis of each joint in its chain (c,), in m.

    For a sphere, only the center is used, because a rotation about the center does not move the sphere. The bound holds
    in every pose, because it is the sum of the distances between the joints.
    """
    levers = np.zeros(chains.chain.shape[1])
    link, at, chain = unit.frame, chains.chain_length[unit.frame] - 1, chains.chain
    reference = None
    reach = 0.0
    while link != WORLD and at >= 0:
        for joint in range(int(chains.first_joint[link + 1]) - 1, int(chains.first_joint[link]) - 1, -1):
            anchor = chains.anchor[joint]
            reach = _farthest(unit.geoms, anchor) if reference is None else reach + _apart(reference, anchor)
            assert chain[unit.frame, at] == joint
            levers[at] = 1.0 if chains.slides[joint] else reach
            reach += travel[joint]
            reference = anchor
            at -= 1
        if reference is not None:
            reference = chains.link_mat[link] @ reference + chains.link_pos[link]
        else:
            unit = unit._replace(geoms=tuple(_in_parent(geom, chains, link) for geom in unit.geoms))
        link = int(chains.parent[link])
    return levers


def _farthest(geoms: Sequence[Geom], anchor: FloatArray) -> float:
    return float(max(np.linalg.norm(geom.pose.position_m - anchor) + geom.swing_m for geom in geoms))


def _apart(one: FloatArray, other: FloatArray) -> float:
    return float(np.linalg.norm(one - other))


def _in_parent(geom: Geom, chains: ChainTables, link: int) -> Geom:
    position = chains.link_mat[link] @ geom.pose.position_m + chains.link_pos[link]
    return geom._replace(pose=geom.pose.__class__(position, chains.link_mat[link] @ geom.pose.matrix))


def planned_levers(chains: ChainTables, pairs: PairTables) -> FloatArray:
    """Return the maximum distance of any unit from the axis of each planned joint (n,), in m, with 1 for a slide.

    A mimic joint is attributed to the joint that it follows.
    """
    levers = np.zeros(len(chains.slides))
    for frame, row in zip(pairs.frame, pairs.lever, strict=True):
        for at in range(chains.chain_length[frame] if frame >= 0 else 0):
            joint = chains.chain[frame, at]
            levers[joint] = max(levers[joint], row[at])
    for follower, leader, steepest in reversed(
        list(zip(chains.follower, chains.leader, chains.steepest, strict=True))
    ):  # leaders come first
        levers[leader] += steepest * levers[follower]
    return np.asarray(levers[chains.planned])
