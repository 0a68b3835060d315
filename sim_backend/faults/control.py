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
    text, done = command.get("text"), list[str]()
    try:
        if text is not None:
            event = parse(str(text))
            player.play([event], now_s())
            player.begin_due(now_s())
            done = [text_of(event)] if event.at_s == event.lasts_s == 0.0 else []
    except FaultError as error:
        raise ValueError(str(error)) from error
    return {
        "time_s": round(now_s(), 3),
        "done": done,
        "active": [text_of(event) for event in player.active.values()],
        "coming": [text_of(event) for event in player.coming],
    }
