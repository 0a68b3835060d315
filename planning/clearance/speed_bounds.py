"""Bounds on the speed of links along an edge, in compiled code.

An edge takes one unit of time. The bound on a unit's speed has two terms. The first term is a sum over the joints of
the unit's chain. Each joint contributes its speed times the maximum distance of the unit from the joint's axis in this
pose. For a sphere, only the center is used. Other joints of the chain can move the unit away from the axis. The second
term is a bound on the resulting growth of these distances. For pairs that are close together, a second bound is
computed, and the lower of the two bounds is used. A plane separates the two convex geoms, so they approach each other
only with their speed perpendicular to the plane, plus a term for the acceleration. A link that slides along an obstacle
is therefore checked in only a few poses. Mimic joints with a nonlinear coupling do not have such a bound.
"""

from math import sqrt
from typing import Any

from planning.clearance.chain_tables import ChainTables
from planning.clearance.compiled import compiled
from planning.clearance.pair_tables import PairTables
from planning.clearance.placement import Placement
from planning.clearance.shapes import POSITION, SWING


@compiled
def _reach(now: Placement, joint: int, x: float, y: float, z: float) -> float:
    """Return the distance of a point from the axis of a hinge."""
    anchor, axis = now.anchor, now.axis
    x, y, z = x - anchor[joint, 0], y - anchor[joint, 1], z - anchor[joint, 2]
    along = x * axis[joint, 0] + y * axis[joint, 1] + z * axis[joint, 2]
    return sqrt(max(x * x + y * y + z * z - along * along, 0.0))


@compiled
def set_rates(chains: ChainTables, pairs: PairTables, now: Placement, speeds: Any) -> None:
    """For each joint in a unit's chain, write the maximum speed of the unit caused by this joint and all later
    joints."""
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
def set_geom_rates(chains: ChainTables, pairs: PairTables, now: Placement, speeds: Any, unit: int) -> None:
    """For each joint in a unit's chain, write the maximum speed of each geom caused by this joint and all later
    joints."""
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
def set_bends(chains: ChainTables, pairs: PairTables, now: Placement, speeds: Any) -> None:
    """Write the maximum rate at which each unit's speed bound grows, and the unit's maximum acceleration. Both values
    hold in every pose."""
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
def _speed_along(chains: ChainTables, now: Placement, link: int, common: int, geom: int) -> tuple[float, float]:
    """Return the speed of a geom's center along ``now.normal``, and the maximum speed added by the geom's rotation."""
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
def approach(chains: ChainTables, pairs: PairTables, now: Placement, pair: int, i: int, j: int) -> float:
    """Return the maximum speed at which two geoms approach each other along ``now.normal``, in either direction."""
    common = pairs.common[pair]
    speed, turning = _speed_along(chains, now, pairs.frame[pairs.one[pair]], common, i)
    back, also = _speed_along(chains, now, pairs.frame[pairs.other[pair]], common, j)
    return abs(speed - back) + turning + also
