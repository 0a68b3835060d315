"""Draw positions and goals for the joints of an arm."""

from collections.abc import Mapping
from random import Random
from typing import Any, Final

from hal.types import JointLimits
from servoloop.simulation.acts import FollowWaypoints, Move
from sim_backend.faults.tails import log_uniform

BEYOND: Final = 0.08
"""Fraction of goals with a position beyond a limit. The controller must reject such a goal."""
ANYWHERE: Final = 0.3
"""Fraction of goals with positions anywhere within the limits. Many of these goals press the arm against the table or
against itself."""
AT_LIMIT: Final = 0.3
"""Fraction of positions that are exactly at a limit, in goals with positions anywhere within the limits."""
NEAR: Final = 0.3
"""Largest position in goals near zero, as a fraction of the distance from zero to the limit."""
OWN_TOLERANCES: Final = 0.3
"""Fraction of goals that have their own tolerances."""
TOLERANCES: Final = (0.01, 0.2)
"""Range of the goals' own tolerances, in rad or m."""
GOAL_TOLERANCES: Final = (0.0005, 0.02)
"""Range of the goals' own goal tolerances, in rad or m. Backlash and friction prevent many of them from being met."""
GOAL_TIMES_S: Final = (0.05, 5.0)
"""Range of the goals' own goal time tolerances, in seconds."""
MIXED: Final = 0.5
"""Fraction of goals that list their joints in an order that differs from that of the controller."""
PARTIAL: Final = 0.4
"""Fraction of goals that contain only some joints. Most controllers reject such a goal, unless a client has changed
their parameters."""
LARGEST: Final = 7.0
"""Largest position drawn for a joint without limits, in rad."""


def draw_positions(random: Random, joints: Mapping[str, JointLimits]) -> dict[str, float]:
    """Draw positions of some or all joints: mostly near zero, sometimes anywhere within the limits, at a limit or
    beyond it."""
    chosen = [name for name in joints if random.random() < 0.6] or [random.choice(list(joints))]
    draw = random.random()
    beyond = random.choice(chosen) if draw < BEYOND else None
    positions = {name: _position(random, joints[name], draw > 1.0 - ANYWHERE) for name in chosen}
    return positions if beyond is None else {**positions, beyond: _beyond(random, joints[beyond])}


def _position(random: Random, limit: JointLimits, anywhere: bool) -> float:
    lower, upper = max(limit.lower, -LARGEST), min(limit.upper, LARGEST)
    if anywhere and random.random() < AT_LIMIT:
        return random.choice([lower, upper])
    if anywhere:
        return round(random.uniform(lower, upper), 4)
    return round(_near(random, lower, upper), 4)


def _near(random: Random, lower: float, upper: float) -> float:
    middle = min(max(0.0, lower), upper)
    return middle + (random.choice([lower, upper]) - middle) * random.uniform(0.0, NEAR)


def _beyond(random: Random, limit: JointLimits) -> float:
    lower, upper = max(limit.lower, -LARGEST), min(limit.upper, LARGEST)
    way = random.uniform(0.05, 0.5) * (upper - lower)
    return round(random.choice([lower - way, upper + way]), 4)


def draw_arm_goal(random: Random, joints: Mapping[str, JointLimits], at_s: float) -> FollowWaypoints | Move:
    """Draw a goal with one or several points, in some cases with its own tolerances."""
    if random.random() < 0.3:
        return _waypoints(random, joints, at_s)
    own = _own_tolerances(random) if random.random() < OWN_TOLERANCES else {}
    positions, seconds = draw_positions(random, joints), round(random.uniform(0.3, 3.0), 2)
    mixed, partial = random.random() < MIXED, random.random() < PARTIAL
    return Move(at_s=at_s, positions=positions, seconds=seconds, mixed=mixed, partial=partial, **own)


def _own_tolerances(random: Random) -> dict[str, Any]:
    """Draw a tolerance for the path and the goal, or a goal tolerance that is hard to meet, with its own time."""
    if random.random() < 0.5:
        return {"tolerance": round(log_uniform(random, *TOLERANCES), 3)}
    tolerance, goal_time_s = log_uniform(random, *GOAL_TOLERANCES), log_uniform(random, *GOAL_TIMES_S)
    return {"at_end": True, "tolerance": round(tolerance, 4), "goal_time_s": round(goal_time_s, 2)}


def _waypoints(random: Random, joints: Mapping[str, JointLimits], at_s: float) -> FollowWaypoints:
    """Draw up to four points for joints in any order, mostly near zero. Some goals have a stamp in the future."""
    mixed = {name: joints[name] for name in random.sample(list(joints), len(joints))}
    anywhere = random.random() < 0.1
    delay_s = round(random.uniform(0.3, 2.0), 2) if random.random() < 0.5 else 0.0
    # Only a goal that is neither slowed down by limits nor replaced shows whether its stamp is ignored.
    most, times_s = (1, (1.0, 2.0)) if delay_s else (4, (0.3, 0.8))
    points = tuple(
        {name: _position(random, limit, anywhere) for name, limit in mixed.items()}
        for _ in range(random.randint(1, most))
    )
    return FollowWaypoints(at_s=at_s, points=points, seconds=round(random.uniform(*times_s), 2), delay_s=delay_s)
