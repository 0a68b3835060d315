"""Draw the actions of a random client from the seed of a run."""

from collections.abc import Callable, Mapping
from random import Random
from typing import Any, Final

from hal.types import JointLimits
from servoloop.campaign.draws.socket_acts import draw_socket_act
from servoloop.simulation.acts import (
    Act,
    Cancel,
    Configure,
    FollowPlan,
    FollowWaypoints,
    Grip,
    GuideArm,
    Jog,
    Move,
    MoveHand,
    Reactivate,
    ScaleSpeed,
    SocketDeath,
    SocketMove,
    SocketRequest,
    SocketStream,
    Stream,
    Switch,
)
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
PAUSE_S: Final = 6.0
"""Longest time between two actions, in seconds. Goals without a result need this much time to end."""
PAUSES: Final = (1.0, 1.0, 1.0)
"""Relative frequencies of short, medium and long pauses between two actions."""
SOCKET_PAUSES: Final = (3.0, 2.0, 1.0)
"""The same frequencies for programs on the command socket, which perform many kinds of actions."""
INTERRUPTED: Final = 0.8
"""Fraction of the motions and freedrives over the command socket that are interrupted by their client program."""
GUIDES_S: Final = 2.0
"""Maximum duration of an interrupted freedrive over the command socket, in seconds."""
SETTLES_S: Final = 1.0
"""Time in which an uninterrupted motion would come to rest and succeed, in seconds."""
STREAMED_AGAIN: Final = 0.5
"""Fraction of the streams over the command socket that are followed by a stream to other joints."""
INTERRUPTIONS: Final = ("death", "death", "stop", "stop", "cancel", "cancel", "release")
"""Ways in which the client program interrupts its motion."""
DURING_HAND_MOTION: Final = 0.6
"""Fraction of the hand's motions during which the client sends a goal for the arm. Such a goal waits for the hand."""
HAND_MOVES_S: Final = 0.4
"""Maximum time from the start of a hand motion until the client sends this goal for the arm, in seconds."""
HAND_TURNS: Final = 0.4
"""Fraction of the hand's motions during which the client sends the hand to another position."""
CANCELED_SOON: Final = 0.2
"""Fraction of goals for the arm that are canceled soon after they were sent. Half of these cancels follow at once, and
half while the goal may still wait for the hand."""
HAND_SWITCHED: Final = 0.5
"""Fraction of the hand's motions during which the client ``switches`` deactivates the hand's controller."""
SWITCHED: Final = 0.5
"""Fraction of motions during which the client ``switches`` deactivates the controller or the hardware."""
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
PARTLY_REPLACED: Final = 0.3
"""Fraction of goals that are replaced during the motion by a goal for one joint."""
CONFIGURED: Final = 0.8
"""Fraction of the clients that change the parameters of the arm controller first."""
SCALED: Final = 0.3
"""Fraction of planned trajectories during which the client changes the speed scaling factor."""
FACTORS: Final = (2.0, 1.0, 3.0)
"""Relative frequencies of a speed scaling factor of 1, a factor of 0, and a factor between 0 and 1."""
IMPOSSIBLE: Final = 0.3
"""Fraction of the controller switches that are impossible."""
ENDS_EARLY: Final = 0.25
"""Fraction of runs that end in the middle of the actions and faults, as if the user stopped the program."""
EARLIEST_S: Final = 1.0
"""Earliest time at which such a run ends, in seconds."""
LARGEST: Final = 7.0
"""Largest position drawn for a joint without limits, in rad."""


def draw_end(seed: int, within_s: float) -> float:
    """Return the time at which a run ends in the middle of its actions and faults, or else ``within_s``, in seconds.

    Args:
        seed: Seed of the run.
        within_s: Time within which actions and faults begin, in seconds.
    """
    random = Random(f"{seed}/end")
    if random.random() >= ENDS_EARLY:
        return within_s
    return round(random.uniform(min(EARLIEST_S, within_s), within_s), 3)


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
        at_s = _extend(random, kind, joints, acts, (at_s, seconds))
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


def _extend(
    random: Random, kind: str, joints: Mapping[str, JointLimits], acts: list[Act], times_s: tuple[float, float]
) -> float:
    """Append the actions that follow soon after the latest action, and return the time at which the next pause starts.

    ``times_s`` contains the time of the latest action and the time within which the actions begin, in seconds.
    """
    at_s, seconds = times_s
    if isinstance(acts[-1], FollowWaypoints):
        at_s += random.choice([0.0, acts[-1].delay_s + (len(acts[-1].points) + 1) * acts[-1].seconds])
    if isinstance(acts[-1], MoveHand) and random.random() < HAND_TURNS:
        at_s = min(at_s + random.uniform(0.0, HAND_MOVES_S), seconds)
        acts.append(MoveHand(at_s=round(at_s, 3), share=round(random.random(), 3)))
    if kind == "switches" and isinstance(acts[-1], MoveHand) and random.random() < HAND_SWITCHED:
        at_s = min(at_s + random.uniform(0.1, HAND_MOVES_S), seconds)
        acts.append(Switch(at_s=round(at_s, 3), for_s=round(random.uniform(0.05, 1.0), 2), hand=True))
    if isinstance(acts[-1], MoveHand) and random.random() < DURING_HAND_MOTION:
        at_s = min(at_s + random.uniform(0.0, HAND_MOVES_S), seconds)
        acts.append(_arm_goal(random, joints, round(at_s, 3)))
    if kind in CONFIGURING and isinstance(acts[-1], Move) and random.random() < PARTLY_REPLACED:
        at_s = min(acts[-1].at_s + random.uniform(0.2, 0.8) * acts[-1].seconds, seconds)
        positions = _positions(random, {name: joints[name] for name in random.sample(list(joints), 1)})
        acts.append(Move(at_s=round(at_s, 3), positions=positions, seconds=acts[-1].seconds, partial=True))
    if isinstance(acts[-1], Move | FollowWaypoints) and random.random() < CANCELED_SOON:
        soon_s = random.choice([0.0, random.uniform(0.0, HAND_MOVES_S)])
        at_s = min(acts[-1].at_s + soon_s, seconds)
        acts.append(Cancel(at_s=round(at_s, 3)))
    if isinstance(acts[-1], FollowPlan) and random.random() < SCALED:
        at_s = min(at_s + random.uniform(0.1, 1.0), seconds)
        acts.append(_speed(random, round(at_s, 3)))
    if kind == "switches" and isinstance(acts[-1], Move) and random.random() < SWITCHED:
        at_s = min(acts[-1].at_s + random.uniform(0.2, 0.8) * acts[-1].seconds, seconds)
        acts.append(_handover(random, round(at_s, 3)))
    if isinstance(acts[-1], SocketStream) and random.random() < STREAMED_AGAIN:
        first = acts[-1]
        at_s = min(first.at_s + first.for_s + random.uniform(0.0, HAND_MOVES_S), seconds)
        others = {name: limit for name, limit in joints.items() if name not in first.positions}
        positions = _positions(random, others or joints)
        acts.append(first.model_copy(update={"at_s": round(at_s, 3), "positions": positions, "leaps": False}))
    if isinstance(acts[-1], SocketMove) and random.random() < INTERRUPTED:
        moved, begun_s = acts[-1], at_s
        at_s = min(at_s + random.uniform(0.1, 0.7) * moved.seconds, seconds)
        acts.append(_interruption(random, moved.connection, round(at_s, 3)))
        # Only a motion that would still be running or succeed shows whether the interruption is ignored.
        at_s = random.choice([at_s, begun_s + moved.seconds, begun_s + moved.seconds + SETTLES_S])
    if isinstance(acts[-1], SocketRequest) and acts[-1].op == "freedrive" and random.random() < INTERRUPTED:
        at_s = min(at_s + random.uniform(0.3, GUIDES_S), seconds)
        acts.append(_interruption(random, acts[-1].connection, round(at_s, 3)))
    return at_s


def _interruption(random: Random, connection: int, at_s: float) -> Act:
    how: Any = random.choice(INTERRUPTIONS)
    if how == "death":
        return SocketDeath(at_s=at_s, connection=connection)
    return SocketRequest(at_s=at_s, connection=connection, op=how)


def _positions(random: Random, joints: Mapping[str, JointLimits]) -> dict[str, float]:
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


def _move(random: Random, joints: Mapping[str, JointLimits], hand: bool, at_s: float) -> Act:
    draw = random.random()
    if draw < 0.25:
        return Cancel(at_s=at_s)
    if draw < 0.35 and hand:
        return MoveHand(at_s=at_s, share=round(random.random(), 3))
    return _arm_goal(random, joints, at_s)


def _arm_goal(random: Random, joints: Mapping[str, JointLimits], at_s: float) -> FollowWaypoints | Move:
    if random.random() < 0.3:
        return _waypoints(random, joints, at_s)
    own = _own_tolerances(random) if random.random() < OWN_TOLERANCES else {}
    positions, seconds = _positions(random, joints), round(random.uniform(0.3, 3.0), 2)
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


def _plan(random: Random, joints: Mapping[str, JointLimits], hand: bool, at_s: float) -> Act:
    draw = random.random()
    if draw < 0.2:
        return Cancel(at_s=at_s)
    if draw < 0.3:
        return _speed(random, at_s)
    scale = random.choice([1.0, round(random.uniform(0.1, 1.0), 2)])
    mixed = random.random() < MIXED
    return FollowPlan(at_s=at_s, positions=_positions(random, joints), scale=scale, mixed=mixed)


def _speed(random: Random, at_s: float) -> ScaleSpeed:
    factor = random.choices([1.0, 0.0, round(random.uniform(0.05, 1.0), 2)], FACTORS)[0]
    return ScaleSpeed(at_s=at_s, factor=factor)


def _stream(random: Random, joints: Mapping[str, JointLimits], hand: bool, at_s: float) -> Act:
    if random.random() < 0.3 and hand:
        return MoveHand(at_s=at_s, share=round(random.random(), 3))
    near = {name: limit for name, limit in joints.items() if random.random() < 0.5} or dict(joints)
    return Stream(at_s=at_s, positions=_positions(random, near), for_s=round(random.uniform(0.2, 2.0), 2))


def _switch(random: Random, joints: Mapping[str, JointLimits], hand: bool, at_s: float) -> Act:
    return _handover(random, at_s) if random.random() < 0.6 else _move(random, joints, hand, at_s)


def _handover(random: Random, at_s: float) -> Act:
    """Draw a deactivation of the arm's controller or of the hardware, and a later activation."""
    for_s = round(random.uniform(0.05, 1.0), 2)
    if random.random() < 0.5:
        return Switch(at_s=at_s, for_s=for_s, impossible=random.random() < IMPOSSIBLE)
    for_s, relax = random.choice([(for_s, False), (for_s, True), (0.0, False), (0.0, False)])
    return Reactivate(at_s=at_s, for_s=for_s, relax=relax, push=_share(random))


def _share(random: Random) -> float:
    return round(random.choice([-1.0, 1.0]) * random.uniform(0.2, 1.0), 2)


def _jog(random: Random, joints: Mapping[str, JointLimits], hand: bool, at_s: float) -> Act:
    if random.random() < 0.15:
        return Cancel(at_s=at_s)
    joint, for_s = random.choice(list(joints)), round(random.choice([0.1, random.uniform(0.1, 2.0)]), 2)
    return Jog(at_s=at_s, joint=joint, share=_share(random), for_s=for_s)


def _guide(random: Random, joints: Mapping[str, JointLimits], hand: bool, at_s: float) -> Act:
    if random.random() < 0.5:
        return _move(random, joints, hand, at_s)
    for_s = round(random.uniform(0.3, 2.0), 2)
    return GuideArm(at_s=at_s, joint=random.choice(list(joints)), share=_share(random), for_s=for_s)


def _grip(random: Random, joints: Mapping[str, JointLimits], hand: bool, at_s: float) -> Act:
    if random.random() < 0.2 or not hand:
        return Move(at_s=at_s, positions=_positions(random, joints), seconds=round(random.uniform(0.3, 3.0), 2))
    share = random.choice([0.0, 1.0, round(random.random(), 3)])
    cancel_after_s = round(random.uniform(0.05, 1.0), 2) if random.random() < 0.25 else 0.0
    speed = round(random.uniform(0.1, 1.0), 2) if random.random() < 0.5 else 0.0
    return Grip(at_s=at_s, share=share, cancel_after_s=cancel_after_s, speed=speed)


def _socket(random: Random, joints: Mapping[str, JointLimits], hand: bool, at_s: float) -> Act:
    return draw_socket_act(random, _positions(random, joints), at_s)


CONFIGURING: Final = frozenset({"moves", "switches"})
"""Clients that may change the parameters of the arm controller."""
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
