"""Limit the speed of a link during a motion."""

import math
from dataclasses import replace

import numpy as np

from nodes.planning.request_errors import RequestError
from planning.group_planner import GroupPlanner
from planning.motion import Motion
from planning.paths.timing import TimedPath


def slowed(group: GroupPlanner, motion: Motion, link: str, speed_m_s: float) -> Motion:
    """Return a motion along the same path in which the speed of a link stays within a limit.

    Args:
        group: Planner for the moving group.
        motion: The motion.
        link: Link whose speed is limited, or empty for the tip of the group.
        speed_m_s: Maximum speed, in m/s. A limit of 0 or less means no limit.

    Raises:
        RequestError: The speed is not a number.
        PlanningError: The link does not exist.
    """
    if math.isnan(speed_m_s):
        raise RequestError("PLANNING_FAILED", "max_cartesian_speed is NaN: send a speed in m/s, or 0 for no limit")
    if speed_m_s <= 0.0:
        return motion
    chain = group.chain(link or None, motion.end)
    own = [motion.joints.index(name) for name in chain.names]
    places_m = chain.transforms(motion.path.positions[:, own])[:, :3, 3]
    lengths_m = np.linalg.norm(np.diff(places_m, axis=0), axis=1)
    stretch = float((lengths_m / np.diff(motion.path.times_s)).max(initial=0.0)) / speed_m_s
    return motion if stretch <= 1.0 else replace(motion, path=_stretched(motion.path, stretch))


def _stretched(path: TimedPath, factor: float) -> TimedPath:
    velocities, accelerations = path.velocities / factor, path.accelerations / factor**2
    return TimedPath(path.times_s * factor, path.positions, velocities, accelerations)
