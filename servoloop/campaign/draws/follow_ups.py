"""Draw the actions that follow soon after another action of a client."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from random import Random
from typing import Any, Final

from hal.types import JointLimits
from servoloop.campaign.draws.goals import draw_arm_goal, draw_positions
from servoloop.campaign.draws.switches import draw_handover, draw_speed
from servoloop.simulation.acts import (
    Act,
    Cancel,
    FollowPlan,
    FollowWaypoints,
    Move,
    MoveHand,
    SocketDeath,
    SocketMove,
    SocketRequest,
    SocketStream,
    Switch,
)

CONFIGURING: Final = frozenset({"moves", "switches"})
"""Clients that may change the parameters of the arm controller."""
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
PARTLY_REPLACED: Final = 0.3
"""Fraction of goals that are replaced during the motion by a goal for one joint."""
SCALED: Final = 0.3
"""Fraction of planned trajectories during which the client changes the speed scaling factor."""


@dataclass(frozen=True, slots=True)
class Latest:
    """The latest action of a client, and the input for drawing the next one."""

    random: Random
    joints: Mapping[str, JointLimits]
    act: Any
    at_s: float
    """Time from which the time of the next action is drawn, in seconds."""
    seconds: float
    """Time within which all actions begin, in seconds."""

    def later_s(self, least_s: float, most_s: float) -> float:
        """Draw a time between ``least_s`` and ``most_s`` after ``at_s``."""
        return min(self.at_s + self.random.uniform(least_s, most_s), self.seconds)

    def in_motion_s(self) -> float:
        """Draw a time in the middle of a motion that begins with the latest action."""
        begin_s, moves_s = float(self.act.at_s), float(self.act.seconds)
        return min(begin_s + self.random.uniform(0.2, 0.8) * moves_s, self.seconds)


FollowUp = Callable[[Latest], tuple[Act, float]]
"""Function that draws an action, and the time at which the next pause starts."""


def follow_up(
    random: Random, kind: str, joints: Mapping[str, JointLimits], acts: list[Act], times_s: tuple[float, float]
) -> float:
    """Append the actions that follow soon after the latest action, and return the time at which the next pause starts.

    ``times_s`` contains the time of the latest action and the time within which the actions begin, in seconds.
    """
    at_s, seconds = times_s
    if isinstance(acts[-1], FollowWaypoints):
        at_s += random.choice([0.0, acts[-1].delay_s + (len(acts[-1].points) + 1) * acts[-1].seconds])
    for follows, share, draw in FOLLOW_UPS:
        if follows(kind, acts[-1]) and random.random() < share:
            act, at_s = draw(Latest(random, joints, acts[-1], at_s, seconds))
            acts.append(act)
    return at_s


def _turn_hand(latest: Latest) -> tuple[Act, float]:
    at_s = latest.later_s(0.0, HAND_MOVES_S)
    return MoveHand(at_s=round(at_s, 3), share=round(latest.random.random(), 3)), at_s


def _switch_hand(latest: Latest) -> tuple[Act, float]:
    at_s = latest.later_s(0.1, HAND_MOVES_S)
    return Switch(at_s=round(at_s, 3), for_s=round(latest.random.uniform(0.05, 1.0), 2), hand=True), at_s


def _move_arm(latest: Latest) -> tuple[Act, float]:
    at_s = latest.later_s(0.0, HAND_MOVES_S)
    return draw_arm_goal(latest.random, latest.joints, round(at_s, 3)), at_s


def _replace_partly(latest: Latest) -> tuple[Act, float]:
    at_s, joints = latest.in_motion_s(), latest.joints
    positions = draw_positions(latest.random, {name: joints[name] for name in latest.random.sample(list(joints), 1)})
    return Move(at_s=round(at_s, 3), positions=positions, seconds=latest.act.seconds, partial=True), at_s


def _cancel(latest: Latest) -> tuple[Act, float]:
    soon_s = latest.random.choice([0.0, latest.random.uniform(0.0, HAND_MOVES_S)])
    at_s = min(latest.act.at_s + soon_s, latest.seconds)
    return Cancel(at_s=round(at_s, 3)), at_s


def _scale_speed(latest: Latest) -> tuple[Act, float]:
    at_s = latest.later_s(0.1, 1.0)
    return draw_speed(latest.random, round(at_s, 3)), at_s


def _switch_arm(latest: Latest) -> tuple[Act, float]:
    at_s = latest.in_motion_s()
    return draw_handover(latest.random, round(at_s, 3)), at_s


def _stream_again(latest: Latest) -> tuple[Act, float]:
    first: SocketStream = latest.act
    at_s = min(first.at_s + first.for_s + latest.random.uniform(0.0, HAND_MOVES_S), latest.seconds)
    others = {name: limit for name, limit in latest.joints.items() if name not in first.positions}
    positions = draw_positions(latest.random, others or latest.joints)
    return first.model_copy(update={"at_s": round(at_s, 3), "positions": positions, "leaps": False}), at_s


def _interrupt_motion(latest: Latest) -> tuple[Act, float]:
    random, moved = latest.random, latest.act
    at_s = latest.later_s(0.1 * moved.seconds, 0.7 * moved.seconds)
    interruption = _interruption(random, moved.connection, round(at_s, 3))
    # Only a motion that would still be running or succeed shows whether the interruption is ignored.
    ends_s = latest.at_s + moved.seconds
    return interruption, random.choice([at_s, ends_s, ends_s + SETTLES_S])


def _interrupt_freedrive(latest: Latest) -> tuple[Act, float]:
    at_s = latest.later_s(0.3, GUIDES_S)
    return _interruption(latest.random, latest.act.connection, round(at_s, 3)), at_s


def _interruption(random: Random, connection: int, at_s: float) -> Act:
    how: Any = random.choice(INTERRUPTIONS)
    if how == "death":
        return SocketDeath(at_s=at_s, connection=connection)
    return SocketRequest(at_s=at_s, connection=connection, op=how)


def _after(*types: type[Act]) -> Callable[[str, Act], bool]:
    return lambda kind, act: isinstance(act, types)


FOLLOW_UPS: Final[tuple[tuple[Callable[[str, Act], bool], float, FollowUp], ...]] = (
    (_after(MoveHand), HAND_TURNS, _turn_hand),
    (lambda kind, act: kind == "switches" and isinstance(act, MoveHand), HAND_SWITCHED, _switch_hand),
    (_after(MoveHand), DURING_HAND_MOTION, _move_arm),
    (lambda kind, act: kind in CONFIGURING and isinstance(act, Move), PARTLY_REPLACED, _replace_partly),
    (_after(Move, FollowWaypoints), CANCELED_SOON, _cancel),
    (_after(FollowPlan), SCALED, _scale_speed),
    (lambda kind, act: kind == "switches" and isinstance(act, Move), SWITCHED, _switch_arm),
    (_after(SocketStream), STREAMED_AGAIN, _stream_again),
    (_after(SocketMove), INTERRUPTED, _interrupt_motion),
    (lambda kind, act: isinstance(act, SocketRequest) and act.op == "freedrive", INTERRUPTED, _interrupt_freedrive),
)
"""Condition on the client and its latest action, frequency and draw of each follow-up, in this order. A follow-up may
follow an action that another follow-up has just appended."""
