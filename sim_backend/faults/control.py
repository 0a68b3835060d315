"""What ``servoloop fault`` asks of a running emulator."""

from collections.abc import Callable, Mapping
from typing import Any

from sim_backend.control import Command, Handler
from sim_backend.faults.errors import FaultError
from sim_backend.faults.player import FaultPlayer
from sim_backend.faults.text import matching, parse, text_of


def obey_faults(player: FaultPlayer, now_s: Callable[[], float], other: Handler, command: Command) -> Mapping[str, Any]:
    """Let a fault happen, whose time counts from now, and say which there are; ``other`` does all other commands.

    ValueError for a fault that is none, or that these servos cannot have.
    """
    if command.get("do") != "fault":
        return other(command)
    text, done, taken = command.get("text"), list[str](), list[str]()
    try:
        if command.get("clear"):
            taken = _taken_back(player, "" if text is None else str(text))
        elif text is not None:
            event = parse(str(text))
            player.play([event], now_s())
            player.begin_due(now_s())
            done = [text_of(event)] if event.at_s == event.lasts_s == 0.0 else []
    except FaultError as error:
        raise ValueError(str(error)) from error
    return {
        "time_s": round(now_s(), 3),
        "done": done,
        "taken_back": taken,
        "active": [text_of(event) for event in player.active.values()],
        "coming": [text_of(event) for event in player.coming],
    }


def _taken_back(player: FaultPlayer, text: str) -> list[str]:
    """Take back the faults that ``text`` names, or all; returns their texts. Raises FaultError if none matches."""
    events = player.take_back(matching(text))
    if text and not events:
        raise FaultError(f"no fault {text} is on or coming")
    return [text_of(event) for event in events]
