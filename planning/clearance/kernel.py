"""Clearances of poses and edges in compiled code.

An edge is checked by conservative advancement. At each checked pose, the clearance of a pair of units is divided by the
maximum speed of these units. The result is a length: the edge is free over this length before and after the pose. The
next poses to check are in the middle of the remaining segments. planning/clearance/speed_bounds.py describes the
speeds.
"""

from math import sqrt
from typing import Any, Final

import numpy as np

from planning.clearance.chain_tables import ChainTables
from planning.clearance.compiled import compiled
from planning.clearance.geom_distance import geom_distance, unit_bound
from planning.clearance.pair_tables import PairTables
from planning.clearance.placement import Placement, place
from planning.clearance.speed_bounds import approach, set_bends, set_geom_rates, set_rates

OPEN: Final = 128
"""Maximum number of unchecked segments of an edge. Each step at least halves a segment, so only an edge of an
impossible length has more unchecked segments. Such an edge is rejected.
"""
MOST: Final = 2_000
"""Maximum number of poses for one edge. An edge that slides along an obstacle may need more poses and is then
rejected.
"""
SHARE: Final = 1e-3
"""Maximum relative underestimation of a distance when an edge is checked."""
EXACT: Final = 1e-9
"""Maximum relative underestimation of a returned distance."""


@compiled
def clearance(pairs: PairTables, now: Placement, start_m: float, share: float) -> tuple[float, int]:
    """Return the smallest distance and its pair, or ``start_m`` and -1 if no distance is below ``start_m``.

    ``pairs.extra`` is subtracted from all distances.
    """
    best, found = start_m, -1
    geoms, centers, radii, first_geom = now.geoms, now.unit_pos, pairs.unit_radius, pairs.first_geom
    for pair in range(len(pairs.one)):
        one, other, extra = pairs.one[pair], pairs.other[pair], pairs.extra[pair]
        if unit_bound(geoms, centers, radii, first_geom, one, other) - extra >= best:
            continue
        for i in range(first_geom[one], first_geom[one + 1]):
            for j in range(first_geom[other], first_geom[other + 1]):
                distance = geom_distance(geoms, i, j, pairs.vertices, (best + extra, share), now.normal) - extra
                if distance < best:
                    best, found = distance, pair
    return best, found


@compiled
def pose_clearance(
    chains: ChainTables, pairs: PairTables, now: Placement, positions: Any, start_m: float
) -> tuple[float, int]:
    """Return the smallest distance at positions (n,) and its pair, or ``start_m`` and -1 if no distance is below
    ``start_m``."""
    place(chains, pairs, now, positions)
    return clearance(pairs, now, start_m, EXACT)


@compiled
def pair_distances(chains: ChainTables, pairs: PairTables, now: Placement, positions: Any, distances: Any) -> None:
    """Write the distance of each pair at positions (n,) into ``distances`` (p,)."""
    place(chains, pairs, now, positions)
    geoms, first_geom = now.geoms, pairs.first_geom
    for pair in range(len(pairs.one)):
        one, other = pairs.one[pair], pairs.other[pair]
        for i in range(first_geom[one], first_geom[one + 1]):
            for j in range(first_geom[other], first_geom[other + 1]):
                distance = geom_distance(geoms, i, j, pairs.vertices, (distances[pair], EXACT), now.normal)
                distances[pair] = min(distances[pair], distance)


@compiled
def _free_part(rate: float, bend: float, reserve_m: float) -> float:
    """Return the length of an edge over which the distance of a pair decreases by at most ``reserve_m``."""
    if rate <= 0.0 and bend <= 0.0:
        return 1e300
    return float(2.0 * reserve_m / (rate + sqrt(rate * rate + 2.0 * bend * reserve_m)))


@compiled
def _free_pair(
    chains: ChainTables, pairs: PairTables, now: Placement, pair: int, bend: float, limits: tuple[float, float, float]
) -> float:
    """Return the length of an edge that is free around a pose for one pair, as ``free_around`` does for all pairs.

    ``limits`` contains the padding, the tolerance and the maximum length.
    """
    padding, tolerance, part = limits
    one, other, common, extra = pairs.one[pair], pairs.other[pair], pairs.common[pair], pairs.extra[pair]
    geoms, rates, first_geom = now.geoms, now.geom_rate, pairs.first_geom
    for i in range(first_geom[one], first_geom[one + 1]):
        for j in range(first_geom[other], first_geom[other + 1]):
            rate = rates[i, common] + rates[j, common]
            enough = max(padding, (rate + 0.5 * bend * part) * part + padding - tolerance)
            distance = geom_distance(geoms, i, j, pairs.vertices, (enough + extra, SHARE), now.normal) - extra
            if distance < padding:
                return -1.0
            if distance < enough:
                reserve = distance - padding + tolerance
                free = _free_part(rate, bend, reserve)
                if distance + extra > 0.0 and free < part:
                    along = approach(chains, pairs, now, pair, i, j)
                    free = max(free, _free_part(along, now.curve[one] + now.curve[other], reserve))
                part = min(part, free)
    return part


@compiled
def free_around(
    chains: ChainTables, pairs: PairTables, now: Placement, speeds: Any, lengths_m: tuple[float, float], part: float
) -> tuple[float, int]:
    """Return the free length of an edge before and after a pose (at most ``part``), and the limiting pair.

    ``lengths_m`` contains the padding and the tolerance. The length is -1 if the clearance of the pose is less than the
    padding.
    """
    padding, tolerance = lengths_m
    set_rates(chains, pairs, now, speeds)
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
        if unit_bound(geoms, centers, radii, first_geom, one, other) - pairs.extra[pair] >= enough:
            continue
        if not now.rated[one]:
            set_geom_rates(chains, pairs, now, speeds, one)
        if frames[other] >= 0 and not now.rated[other]:
            set_geom_rates(chains, pairs, now, speeds, other)
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
    """Return the position on an edge (0 to 1) at which a pair comes too close, the pair, and the number of poses
    checked.

    ``ends`` (2, n) contains the joint positions at both ends. The first two values are -1 if the edge is free.
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
    set_bends(chains, pairs, now, speeds)
    low, high = np.zeros(OPEN), np.zeros(OPEN)
    high[0], count, checked = 1.0, 1, 0
    positions = np.empty(len(chains.planned))
    while count > 0:
        if checked >= MOST or count >= OPEN:
            return low[count - 1], now.hints[0], checked
        count -= 1
        start, end = low[count], high[count]
        middle = 0.5 * (start + end)
        for i in range(len(positions)):
            positions[i] = ends[0, i] + (ends[1, i] - ends[0, i]) * middle
        place(chains, pairs, now, positions)
        checked += 1
        half = 0.5 * (end - start)
        free, pair = free_around(chains, pairs, now, speeds, (padding, tolerance), half)
        if free < 0.0:
            return middle, pair, checked
        if free < half:
            low[count], high[count] = middle + free, end
            low[count + 1], high[count + 1] = start, middle - free
            count += 2
    return -1.0, -1, checked
