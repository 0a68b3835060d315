"""Clearances of poses and edges in compiled code.

An edge is checked by conservative advancement. At a pose, the clearance of a pair divided by the largest speed of its
two units gives the part of the edge that is free, before and after the pose. The next poses are in the middle of the
remaining parts.

The largest speed of a unit has two terms. The first is the sum, over the joints of its chain, of the joint's speed
multiplied by the unit's largest distance from the joint's axis in this pose. A sphere counts as its center. The second
one bounds how these distances grow: other joints of the chain move the unit away from the axis.

Near pairs have a second bound, and the better one counts. A plane separates the two convex geoms at their distance.
Only the speed at right angles to the plane brings them nearer, plus a term for the acceleration. A link that slides
along an obstacle is therefore checked in few poses. Mimic joints that follow a curve have no such bound.
"""

from math import sqrt
from typing import Any, Final

import numpy as np

from planning.chain_tables import ChainTables
from planning.compiled import compiled
from planning.convex_distance import core_distance, in_frame, in_world, support
from planning.pair_tables import PairTables
from planning.placement import Placement, place
from planning.shapes import (
    KIND,
    MARGIN,
    MATRIX,
    PLANE,
    POINT,
    POSITION,
    RADIUS,
    SWING,
    is_exact,
    point_direction,
    point_distance,
)

OPEN: Final = 128
"""Maximum number of open parts of an edge. Parts at least halve, so they are never as many."""
MOST: Final = 2_000
"""Maximum number of poses for one edge. An edge that slides along something for longer is refused."""
SHARE: Final = 1e-3
"""Share by which a distance may be underestimated in the check of an edge."""
EXACT: Final = 1e-9
"""Share by which a distance may be underestimated as a result."""


@compiled
def _from_center(geoms: Any, geom: int, cx: float, cy: float, cz: float) -> float:
    """Return the distance of a point from a geom, or a lower bound."""
    x, y, z = cx - geoms[geom, POSITION], cy - geoms[geom, POSITION + 1], cz - geoms[geom, POSITION + 2]
    if geoms[geom, KIND] != POINT:
        x, y, z = in_frame(geoms, geom, x, y, z)
    return float(point_distance(geoms, geom, x, y, z) - geoms[geom, MARGIN])


@compiled
def _from_geom(geoms: Any, geom: int, other: int) -> float:
    """Return the distance of the center of ``other`` from a geom, or a lower bound."""
    x, y, z = geoms[other, POSITION], geoms[other, POSITION + 1], geoms[other, POSITION + 2]
    return _from_center(geoms, geom, x, y, z)


@compiled
def _write_normal(geoms: Any, geom: int, other: int, normal: Any) -> None:
    """Write the direction from the nearest point of ``geom`` to the center of ``other``; 0 if the center is inside."""
    x, y, z = (
        geoms[other, POSITION] - geoms[geom, POSITION],
        geoms[other, POSITION + 1] - geoms[geom, POSITION + 1],
        geoms[other, POSITION + 2] - geoms[geom, POSITION + 2],
    )
    if geoms[geom, KIND] != POINT:
        x, y, z = in_frame(geoms, geom, x, y, z)
        x, y, z = point_direction(geoms, geom, x, y, z)
        x, y, z = in_world(geoms, geom, x, y, z)
    length = max(sqrt(x * x + y * y + z * z), 1e-300)
    normal[0], normal[1], normal[2] = x / length, y / length, z / length


@compiled
def _unit_bound(geoms: Any, centers: Any, radii: Any, first: Any, one: int, other: int) -> float:
    """Return a lower bound of the distance of two units, from the spheres around them."""
    ax, ay, az = centers[one, 0], centers[one, 1], centers[one, 2]
    bx, by, bz = centers[other, 0], centers[other, 1], centers[other, 2]
    if first[other + 1] - first[other] == 1:
        bound = _from_center(geoms, first[other], ax, ay, az) - radii[one]
    else:
        bound = sqrt((ax - bx) ** 2 + (ay - by) ** 2 + (az - bz) ** 2) - radii[one] - radii[other]
    if first[one + 1] - first[one] == 1:
        bound = max(bound, _from_center(geoms, first[one], bx, by, bz) - radii[other])
    return float(bound)


@compiled
def _core_distance(geoms: Any, one: int, other: int, vertices: Any, goal: tuple[float, float], normal: Any) -> float:
    margin = geoms[one, MARGIN] + geoms[other, MARGIN]
    if geoms[other, KIND] == PLANE:
        nx, ny, nz = geoms[other, MATRIX + 2], geoms[other, MATRIX + 5], geoms[other, MATRIX + 8]
        normal[0], normal[1], normal[2] = nx, ny, nz
        x, y, z = support(geoms, one, vertices, -nx, -ny, -nz)
        x, y, z = x - geoms[other, POSITION], y - geoms[other, POSITION + 1], z - geoms[other, POSITION + 2]
        return float(nx * x + ny * y + nz * z - margin)
    return float(core_distance(geoms, one, other, vertices, (goal[0] + margin, goal[1]), normal) - margin)


@compiled
def _geom_distance(geoms: Any, one: int, other: int, vertices: Any, goal: tuple[float, float], normal: Any) -> float:
    """Return the distance of two geoms, or a lower bound that is above ``goal[0]``.

    ``goal`` is (beyond, share) as in ``core_distance``. The direction of a distance up to ``goal[0]`` is written to
    ``normal`` (3,).
    """
    if geoms[one, KIND] == PLANE:
        one, other = other, one
    if geoms[one, KIND] == PLANE:
        return 1e300
    bound = _from_geom(geoms, other, one) - geoms[one, RADIUS]
    if geoms[one, KIND] == POINT and is_exact(geoms[other, KIND]):
        if bound <= goal[0]:
            _write_normal(geoms, other, one, normal)
        return float(bound)
    if geoms[other, KIND] != PLANE:
        back = _from_geom(geoms, one, other) - geoms[other, RADIUS]
        if geoms[other, KIND] == POINT and is_exact(geoms[one, KIND]):
            if back <= goal[0]:
                _write_normal(geoms, one, other, normal)
            return float(back)
        bound = max(bound, back)
    if bound > goal[0]:
        return float(bound)
    return _core_distance(geoms, one, other, vertices, goal, normal)


@compiled
def clearance(pairs: PairTables, now: Placement, start_m: float, share: float) -> tuple[float, int]:
    """Return the smallest distance below ``start_m`` and its pair, or ``start_m`` and -1."""
    best, found = start_m, -1
    geoms, centers, radii, first_geom = now.geoms, now.unit_pos, pairs.unit_radius, pairs.first_geom
    for pair in range(len(pairs.one)):
        one, other = pairs.one[pair], pairs.other[pair]
        if _unit_bound(geoms, centers, radii, first_geom, one, other) >= best:
            continue
        for i in range(first_geom[one], first_geom[one + 1]):
            for j in range(first_geom[other], first_geom[other + 1]):
                distance = _geom_distance(geoms, i, j, pairs.vertices, (best, share), now.normal)
                if distance < best:
                    best, found = distance, pair
    return best, found


@compiled
def pose_clearance(
    chains: ChainTables, pairs: PairTables, now: Placement, positions: Any, start_m: float
) -> tuple[float, int]:
    """Return the smallest distance below ``start_m`` at positions (n,) and its pair, or ``start_m`` and -1."""
    place(chains, pairs, now, positions)
    return clearance(pairs, now, start_m, EXACT)


@compiled
def _reach(now: Placement, joint: int, x: float, y: float, z: float) -> float:
    """Return the distance of a point from the axis of a hinge."""
    anchor, axis = now.anchor, now.axis
    x, y, z = x - anchor[joint, 0], y - anchor[joint, 1], z - anchor[joint, 2]
    along = x * axis[joint, 0] + y * axis[joint, 1] + z * axis[joint, 2]
    return sqrt(max(x * x + y * y + z * z - along * along, 0.0))


@compiled
def _set_rates(chains: ChainTables, pairs: PairTables, now: Placement, speeds: Any) -> None:
    """Write the largest speed of each unit caused by the last joints of its chain, from each joint on."""
    centers, radii, slides = now.unit_pos, pairs.unit_swing, chains.slides
    for unit in range(len(pairs.frame)):
        link = pairs.frame[unit]
        if link < 0:
            continue
        total = 0.0
        now.rate[unit, chains.chain_length[link]] = 0.0
        for at in range(chains.chain_length[link] - 1, -1, -1):
            joint = chains.chain[link, at]
            if speeds[joint] > 0.0:
                reach = 1.0
                if not slides[joint]:
                    reach = _reach(now, joint, centers[unit, 0], centers[unit, 1], centers[unit, 2]) + radii[unit]
                total += speeds[joint] * reach
            now.rate[unit, at] = total


@compiled
def _set_geom_rates(chains: ChainTables, pairs: PairTables, now: Placement, speeds: Any, unit: int) -> None:
    """Write the same for each geom of a unit."""
    geoms, link, slides, rates = now.geoms, pairs.frame[unit], chains.slides, now.geom_rate
    now.rated[unit] = True
    for geom in range(pairs.first_geom[unit], pairs.first_geom[unit + 1]):
        total = 0.0
        rates[geom, chains.chain_length[link]] = 0.0
        x, y, z = geoms[geom, POSITION], geoms[geom, POSITION + 1], geoms[geom, POSITION + 2]
        for at in range(chains.chain_length[link] - 1, -1, -1):
            joint = chains.chain[link, at]
            if speeds[joint] > 0.0:
                total += speeds[joint] * (1.0 if slides[joint] else _reach(now, joint, x, y, z) + geoms[geom, SWING])
            rates[geom, at] = total


@compiled
def _set_bends(chains: ChainTables, pairs: PairTables, now: Placement, speeds: Any) -> None:
    """Write the largest growth of each unit's speed, and its largest acceleration. They hold in every pose."""
    straight = True
    for i in range(len(chains.follower)):
        for power in range(2, 5):
            straight = straight and chains.coefficients[i, power] == 0.0
    for unit in range(len(pairs.frame)):
        link, bend, curve, later = pairs.frame[unit], 0.0, 0.0, 0.0
        if link >= 0:
            for at in range(chains.chain_length[link] - 1, -1, -1):
                joint = chains.chain[link, at]
                speed, own = speeds[joint], speeds[joint] * pairs.lever[unit, at]
                if not chains.slides[joint]:
                    bend += speed * later
                    curve += speed * (own + 2.0 * later)
                later += own
        now.bend[unit] = bend
        now.curve[unit] = curve if straight else 1e300


@compiled
def _free_part(rate: float, bend: float, reserve_m: float) -> float:
    """Return the part of an edge in which a pair comes nearer by at most ``reserve_m``."""
    if rate <= 0.0 and bend <= 0.0:
        return 1e300
    return float(2.0 * reserve_m / (rate + sqrt(rate * rate + 2.0 * bend * reserve_m)))


@compiled
def _speed_along(chains: ChainTables, now: Placement, link: int, common: int, geom: int) -> tuple[float, float]:
    """Return the speed of a geom's center along ``now.normal``, and the largest speed added by its rotation."""
    n, signed, anchor, axes, geoms = now.normal, now.signed, now.anchor, now.axis, now.geoms
    speed = wx = wy = wz = 0.0
    if link < 0:
        return 0.0, 0.0
    for at in range(common, chains.chain_length[link]):
        joint = chains.chain[link, at]
        rate = signed[joint]
        ax, ay, az = rate * axes[joint, 0], rate * axes[joint, 1], rate * axes[joint, 2]
        if chains.slides[joint]:
            speed += ax * n[0] + ay * n[1] + az * n[2]
            continue
        x, y, z = (
            geoms[geom, POSITION] - anchor[joint, 0],
            geoms[geom, POSITION + 1] - anchor[joint, 1],
            geoms[geom, POSITION + 2] - anchor[joint, 2],
        )
        speed += (ay * z - az * y) * n[0] + (az * x - ax * z) * n[1] + (ax * y - ay * x) * n[2]
        wx, wy, wz = wx + ax, wy + ay, wz + az
    x, y, z = wy * n[2] - wz * n[1], wz * n[0] - wx * n[2], wx * n[1] - wy * n[0]
    return speed, sqrt(x * x + y * y + z * z) * geoms[geom, SWING]


@compiled
def _approach(chains: ChainTables, pairs: PairTables, now: Placement, pair: int, i: int, j: int) -> float:
    """Return the largest speed at which two geoms approach each other along ``now.normal``, in either direction."""
    common = pairs.common[pair]
    speed, turning = _speed_along(chains, now, pairs.frame[pairs.one[pair]], common, i)
    back, also = _speed_along(chains, now, pairs.frame[pairs.other[pair]], common, j)
    return abs(speed - back) + turning + also


@compiled
def _free_pair(
    chains: ChainTables, pairs: PairTables, now: Placement, pair: int, bend: float, limits: tuple[float, float, float]
) -> float:
    """Return the part of an edge that is free around a pose for one pair, as ``free_around`` does for all pairs.

    ``limits`` are the padding, the tolerance and the largest part.
    """
    padding, tolerance, part = limits
    one, other, common = pairs.one[pair], pairs.other[pair], pairs.common[pair]
    geoms, rates, first_geom = now.geoms, now.geom_rate, pairs.first_geom
    for i in range(first_geom[one], first_geom[one + 1]):
        for j in range(first_geom[other], first_geom[other + 1]):
            rate = rates[i, common] + rates[j, common]
            enough = max(padding, (rate + 0.5 * bend * part) * part + padding - tolerance)
            distance = _geom_distance(geoms, i, j, pairs.vertices, (enough, SHARE), now.normal)
            if distance < padding:
                return -1.0
            if distance < enough:
                reserve = distance - padding + tolerance
                free = _free_part(rate, bend, reserve)
                if distance > 0.0 and free < part:
                    along = _approach(chains, pairs, now, pair, i, j)
                    free = max(free, _free_part(along, now.curve[one] + now.curve[other], reserve))
                part = min(part, free)
    return part


@compiled
def free_around(
    chains: ChainTables, pairs: PairTables, now: Placement, speeds: Any, lengths_m: tuple[float, float], part: float
) -> tuple[float, int]:
    """Return the part of an edge that is free before and after a pose, at most ``part``; and the pair that limits it.

    ``lengths_m`` are the padding and the tolerance. The result is -1 if the pose has less clearance than the padding.
    """
    padding, tolerance = lengths_m
    _set_rates(chains, pairs, now, speeds)
    now.rated[:] = False
    limiting, hints = -1, now.hints
    geoms, centers, radii, first_geom = now.geoms, now.unit_pos, pairs.unit_radius, pairs.first_geom
    rates, bends, frames = now.rate, now.bend, pairs.frame
    for number in range(-2, len(pairs.one)):
        pair = hints[number + 2] if number < 0 else number
        if pair < 0:
            continue
        one, other, common = pairs.one[pair], pairs.other[pair], pairs.common[pair]
        bend, rate = bends[one] + bends[other], rates[one, common] + rates[other, common]
        enough = max(padding, (rate + 0.5 * bend * part) * part + padding - tolerance)
        if _unit_bound(geoms, centers, radii, first_geom, one, other) >= enough:
            continue
        if not now.rated[one]:
            _set_geom_rates(chains, pairs, now, speeds, one)
        if frames[other] >= 0 and not now.rated[other]:
            _set_geom_rates(chains, pairs, now, speeds, other)
        free = _free_pair(chains, pairs, now, pair, bend, (padding, tolerance, part))
        if free < part:
            part, limiting = free, pair
        if free < 0.0:
            break
    if limiting >= 0 and limiting != hints[0]:
        hints[0], hints[1] = limiting, hints[0]
    return part, limiting


@compiled
def edge_contact(
    chains: ChainTables, pairs: PairTables, now: Placement, ends: Any, padding: float, tolerance: float
) -> tuple[float, int, int]:
    """Return the part of an edge at which it comes too near to something, the pair, and the number of poses checked.

    ``ends`` (2, n) are the positions at both ends. The part and the pair are -1 if the edge is free.
    """
    speeds, signed = np.zeros(len(chains.slides)), now.signed
    signed[:] = 0.0
    now.hints[:] = -1
    for i in range(len(chains.planned)):
        signed[chains.planned[i]] = ends[1, i] - ends[0, i]
        speeds[chains.planned[i]] = abs(ends[1, i] - ends[0, i])
    for i in range(len(chains.follower)):
        follower, leader = chains.follower[i], chains.leader[i]
        signed[follower] = chains.coefficients[i, 1] * signed[leader]
        speeds[follower] = chains.steepest[i] * speeds[leader]
    _set_bends(chains, pairs, now, speeds)
    low, high = np.zeros(OPEN), np.zeros(OPEN)
    high[0], count, checked = 1.0, 1, 0
    positions = np.empty(len(chains.planned))
    while count > 0:
        count -= 1
        start, end = low[count], high[count]
        middle = 0.5 * (start + end)
        for i in range(len(positions)):
            positions[i] = ends[0, i] + (ends[1, i] - ends[0, i]) * middle
        place(chains, pairs, now, positions)
        checked += 1
        half = 0.5 * (end - start)
        free, pair = free_around(chains, pairs, now, speeds, (padding, tolerance), half)
        if free < 0.0 or checked >= MOST:
            return middle, pair, checked
        if free < half:
            low[count], high[count] = middle + free, end
            low[count + 1], high[count + 1] = start, middle - free
            count += 2
    return -1.0, -1, checked
