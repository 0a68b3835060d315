"""Draw an action for one of two programs on the command socket."""

from collections.abc import Callable
from random import Random
from typing import Any, Final

from servoloop.campaign.socket_clients.nonsense import FAULTS
from servoloop.simulation.acts import (
    Act,
    SocketDeath,
    SocketMove,
    SocketNonsense,
    SocketRequest,
    SocketStall,
    SocketStream,
)

FIRST: Final = 0.8
"""Fraction of actions performed by the first program. The second program's requests for control of the arm are mostly
denied."""
REQUESTS: Final = (
    *("take", "seize", "release", "stop", "cancel", "state"),
    *("freedrive", "freedrive", "freedrive", "freedrive_end"),
)
"""Requests of a program. Freedrive is drawn more often, because only an interrupted freedrive tests whether the stack
ends freedrive."""


def draw_socket_act(random: Random, positions: dict[str, float], at_s: float) -> Act:
    """Draw an action.

    Args:
        random: Random number generator.
        positions: Target of a motion or stream, in rad or m, keyed by joint name.
        at_s: Time of the action after the arm becomes active, in seconds.
    """
    (draw,) = random.choices([draw for draw, _ in DRAWS], [weight for _, weight in DRAWS])
    fields = {"at_s": at_s, "connection": 1 if random.random() < FIRST else 2}
    return draw({**fields, "positions": positions}, random) if draw in TARGETED else draw(fields, random)


def _seconds(random: Random, least_s: float, most_s: float) -> float:
    return round(random.uniform(least_s, most_s), 2)


def _move(fields: dict[str, Any], random: Random) -> Act:
    op = random.choice(("move", "move", "goal", "set_point"))
    return SocketMove(**fields | {"op": op, "seconds": _seconds(random, 0.3, 3.0)})


def _stream(fields: dict[str, Any], random: Random) -> Act:
    op = random.choice(("targets", "targets", "set_point"))
    how = {"op": op, "for_s": _seconds(random, 0.2, 2.0)}
    return SocketStream(**fields | how, leaps=random.random() < 0.3, closes=random.random() < 0.5)


def _stall(fields: dict[str, Any], random: Random) -> Act:
    """Draw a stall that ends either while the message is still valid or when it is too old."""
    return SocketStall(**fields, for_s=random.choice((_seconds(random, 0.05, 0.4), _seconds(random, 0.6, 3.0))))


def _request(fields: dict[str, Any], random: Random) -> Act:
    return SocketRequest(**fields, op=random.choice(REQUESTS))


def _nonsense(fields: dict[str, Any], random: Random) -> Act:
    return SocketNonsense(**fields, fault=random.choice(FAULTS))


def _death(fields: dict[str, Any], random: Random) -> Act:
    return SocketDeath(**fields, half=random.random() < 0.5)


TARGETED: Final = (_move, _stream, _stall)
"""Functions that draw an action that has a target."""
DRAWS: Final[tuple[tuple[Callable[[dict[str, Any], Random], Act], float], ...]] = (
    (_move, 0.45),
    (_stream, 0.2),
    (_nonsense, 0.08),
    (_request, 0.12),
    (_stall, 0.08),
    (_death, 0.07),
)
"""Functions that draw the actions, each with its probability."""
