"""What ``servoloop fault`` asks of a running emulator."""

from collections.abc import Callable, Mapping
from typing import Any

from sim_backend.control import Command, Handler
from sim_backend.faults.errors import FaultError
from sim_backend.faults.player import FaultPlayer
from sim_backend.faults.text import parse, text_of


def obey_faults(player: FaultPlayer, now_s: Callable[[], float], other: Handler, command: Command) -> Mapping[str, Any]:
    """Let a fault happen, whose time counts from now, and say which there are; ``other`` does all other commands.

    ValueError for a fault that is none, or that these servos cannot have.
    """
    if command.get("do") != "fault":
        return other(command)
    text = command.get("text")
    try:
        if text is not None:
            player.play([parse(str(text))], now_s())
            player.begin_due(now_s())
    except FaultError as error:
        raise ValueError(str(error)) from error
    return {
        "time_s": round(now_s(), 3),
        "active": [text_of(event) for event in player.active.values()],
        "coming": [text_of(event) for event in player.coming],
    }
