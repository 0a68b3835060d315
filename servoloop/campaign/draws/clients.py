"""Draw the actions of a random client from the seed of a run."""

from collections.abc import Callable, Mapping
from random import Random
from typing import Any, Final

from hal.types import JointLimits
from servoloop.campaign.draws.follow_ups import CONFIGURING, follow_up
from servoloop.campaign.draws.goals import (
    GOAL_TIMES_S,
    GOAL_TOLERANCES,
    MIXED,
    TOLERANCES,
    draw_arm_goal,
    draw_positions,
)
from servoloop.campaign.draws.socket_acts import draw_socket_act
from servoloop.campaign.draws.switches import draw_handover, draw_share, draw_speed
from servoloop.simulation.acts import (
    Act,
    Cancel,
    Configure,
    FollowPlan,
    Grip,
    GuideArm,
    Jog,
    Move,
    MoveHand,
    Stream,
)
from sim_backend.faults.tails import log_uniform

PAUSE_S: Final = 6.0
"""Longest time between two actions, in seconds. Goals without a result need this much time to end."""
PAUSES: Final = (1.0, 1.0, 1.0)
"""Relative frequencies of short, medium and long pauses between two actions."""
SOCKET_PAUSES: Final = (3.0, 2.0, 1.0)
"""The same frequencies for programs on the command socket, which perform many kinds of actions."""
CONFIGURED: Final = 0.8
"""Fraction of the clients that change the parameters of the arm controller first."""


def draw_client(kind: str, seed: int, joints: Mapping[str, JointLimits], hand: bool, seconds: float) -> tuple[Act, ...]:
    """Return the actions of one client in chronological order. A client of type ``job`` performs no actions besides its
    jobs.

    Args:
        kind: Type of the client.
        seed: Seed of the run.
        joints: Limits of the joints of the arm's trajectory controller, keyed by joint name.
        hand: Whether the arm has a hand.
        seconds: Time within which the actions begin, in seconds.
    """
    if kind == "job":
        return ()
    random = Random(f"{seed}/client/{kind}")
    acts: list[Act] = []
    at_s = random.uniform(0.0, 0.3)
    if kind in CONFIGURING and random.random() < CONFIGURED:
        acts.append(_configuration(random))
    while at_s < seconds:
        acts.append(DRAWS[kind](random, joints, hand, round(at_s, 3)))
        at_s = follow_up(random, kind, joints, acts, (at_s, seconds))
        pauses = [random.uniform(0.05, 0.6), random.uniform(0.5, 3.0), random.uniform(3.0, PAUSE_S)]
        at_s += random.choices(pauses, SOCKET_PAUSES if kind == "sockets" else PAUSES)[0]
    return tuple(acts)


def _configuration(random: Random) -> Configure:
    """Draw new parameters of the arm controller. Some tolerances are hard to meet."""
    path, goal, goal_time_s = (
        round(log_uniform(random, *limits), 4) if random.random() < 0.5 else 0.0
        for limits in (TOLERANCES, GOAL_TOLERANCES, GOAL_TIMES_S)
    )
    return Configure(
        at_s=0.0,
        path_tolerance=path,
        goal_tolerance=goal,
        goal_time_s=goal_time_s,
        partial=random.random() < 0.85,
    )


def _move(random: Random, joints: Mapping[str, JointLimits], hand: bool, at_s: float) -> Act:
    draw = random.random()
    if draw < 0.25:
        return Cancel(at_s=at_s)
    if draw < 0.35 and hand:
        return MoveHand(at_s=at_s, share=round(random.random(), 3))
    return draw_arm_goal(random, joints, at_s)


def _plan(random: Random, joints: Mapping[str, JointLimits], hand: bool, at_s: float) -> Act:
    draw = random.random()
    if draw < 0.2:
        return Cancel(at_s=at_s)
    if draw < 0.3:
        return draw_speed(random, at_s)
    scale = random.choice([1.0, round(random.uniform(0.1, 1.0), 2)])
    mixed = random.random() < MIXED
    return FollowPlan(at_s=at_s, positions=draw_positions(random, joints), scale=scale, mixed=mixed)


def _stream(random: Random, joints: Mapping[str, JointLimits], hand: bool, at_s: float) -> Act:
    if random.random() < 0.3 and hand:
        return MoveHand(at_s=at_s, share=round(random.random(), 3))
    near = {name: limit for name, limit in joints.items() if random.random() < 0.5} or dict(joints)
    return Stream(at_s=at_s, positions=draw_positions(random, near), for_s=round(random.uniform(0.2, 2.0), 2))


def _switch(random: Random, joints: Mapping[str, JointLimits], hand: bool, at_s: float) -> Act:
    return draw_handover(random, at_s) if random.random() < 0.6 else _move(random, joints, hand, at_s)


def _jog(random: Random, joints: Mapping[str, JointLimits], hand: bool, at_s: float) -> Act:
    if random.random() < 0.15:
        return Cancel(at_s=at_s)
    joint, for_s = random.choice(list(joints)), round(random.choice([0.1, random.uniform(0.1, 2.0)]), 2)
    return Jog(at_s=at_s, joint=joint, share=draw_share(random), for_s=for_s)


def _guide(random: Random, joints: Mapping[str, JointLimits], hand: bool, at_s: float) -> Act:
    if random.random() < 0.5:
        return _move(random, joints, hand, at_s)
    for_s = round(random.uniform(0.3, 2.0), 2)
    return GuideArm(at_s=at_s, joint=random.choice(list(joints)), share=draw_share(random), for_s=for_s)


def _grip(random: Random, joints: Mapping[str, JointLimits], hand: bool, at_s: float) -> Act:
    if random.random() < 0.2 or not hand:
        return Move(at_s=at_s, positions=draw_positions(random, joints), seconds=round(random.uniform(0.3, 3.0), 2))
    share = random.choice([0.0, 1.0, round(random.random(), 3)])
    cancel_after_s = round(random.uniform(0.05, 1.0), 2) if random.random() < 0.25 else 0.0
    speed = round(random.uniform(0.1, 1.0), 2) if random.random() < 0.5 else 0.0
    return Grip(at_s=at_s, share=share, cancel_after_s=cancel_after_s, speed=speed)


def _socket(random: Random, joints: Mapping[str, JointLimits], hand: bool, at_s: float) -> Act:
    return draw_socket_act(random, draw_positions(random, joints), at_s)


DRAWS: Final[Mapping[str, Callable[[Random, Mapping[str, JointLimits], bool, float], Any]]] = {
    "moves": _move,
    "plans": _plan,
    "streams": _stream,
    "switches": _switch,
    "jogs": _jog,
    "guides": _guide,
    "grips": _grip,
    "sockets": _socket,
}
