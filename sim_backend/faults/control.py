"""Handle the commands that ``servoloop fault`` sends to a running emulator."""

from collections.abc import Callable, Mapping
from typing import Any

from sim_backend.control import Command, Handler
from sim_backend.faults.fault_error import FaultError
from sim_backend.faults.player import FaultPlayer
from sim_backend.faults.text import matching, parse, text_of


def handle_fault_command(
    player: FaultPlayer, now_s: Callable[[], float], other: Handler, command: Command
) -> Mapping[str, Any]:
    """Start a fault, or end faults, and return the active and the scheduled faults.

    The times of the fault are relative to the current time. The function ``other`` handles all other commands. Raises
    ValueError if a fault is unknown or is not supported by these servos.
    """
    if command.get("do") != "fault":
        return other(command)
    text, done, taken = command.get("text"), list[str](), list[str]()
    try:
        if command.get("clear"):
            taken = _cancel(player, "" if text is None else str(text))
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


def _cancel(player: FaultPlayer, text: str) -> list[str]:
    """End the faults that match ``text``, or all faults, and return the descriptions of these faults. Raises FaultError
    if no fault matches."""
    events = player.cancel(matching(text))
    if text and not events:
        raise FaultError(f"no fault {text} is active or scheduled")
    return [text_of(event) for event in events]
