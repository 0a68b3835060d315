"""Messages that the command socket of every stack must reject."""

import json
import math
from collections.abc import Mapping
from typing import Any, Final

from hal.types import JointLimits
from servoloop.command_socket.messages import MAX_LINE_BYTES, VERSION
from servoloop.simulation.acts import SocketNonsense

BEYOND: Final = 0.1
"""Distance beyond a limit, as a fraction of the joint's range."""
LONG_AGO_S: Final = 1.0
"""Age of a command that is too old, in seconds."""
AHEAD_S: Final = 10.0
"""Time by which the timestamp of a command is in the future, in seconds."""
NO_GOAL: Final = 999_999
"""Number of a goal that does not exist."""
WITHOUT_ID: Final[Mapping[str, bytes]] = {
    "not_json": b"move the arm\n",
    "not_utf8": b'{"v":1,"id":"nonsense","op":"\xff"}\n',
    "not_an_object": b"[1,2,3]\n",
    "too_large": b"x" * (MAX_LINE_BYTES + 1),
}


def line_of(number: int | str, op: str, **fields: Any) -> bytes:
    """Return a message in the form that a client sends. Unlike ``encode``, this function can write NaN and infinity."""
    return json.dumps({"v": VERSION, "id": number, "op": op, **fields}).encode() + b"\n"


def nonsense(fault: str, number: str, joints: Mapping[str, JointLimits], now_s: float) -> bytes:
    """Return the bytes of an invalid message.

    Args:
        fault: Error in the message, as in ``SocketNonsense``.
        number: ID of the message, if it has one.
        joints: Limits of the arm's joints, keyed by joint name.
        now_s: Time of the stack, in seconds.
    """
    if fault in WITHOUT_ID:
        return WITHOUT_ID[fault]
    if fault == "unknown_goal":
        return line_of(number, "cancel", goal=NO_GOAL)
    names, middle = list(joints), [min(max(0.0, one.lower), one.upper) for one in joints.values()]
    valid: dict[str, Any] = {"joints": names, "times_s": [1.0], "positions": [middle], "sent_s": now_s}
    beyond = [one.upper + BEYOND * (one.upper - one.lower) for one in joints.values()]
    changes: Mapping[str, dict[str, Any]] = {
        "other_version": {"v": VERSION + 1},
        "no_version": {"v": None},
        "unknown_message": {"op": "dance"},
        "unknown_field": {"speed": 1.0},
        "missing_field": {},
        "nan": {"positions": [[math.nan, *middle[1:]]]},
        "infinity": {"positions": [[*middle[:-1], math.inf]]},
        "unknown_joint": {"joints": [*names[:-1], "no_such_joint"]},
        "beyond_limits": {"positions": [beyond]},
        "too_few_positions": {"positions": [middle[1:]]},
        "back_in_time": {"times_s": [1.0, 0.5], "positions": [middle, middle]},
        "sent_long_ago": {"sent_s": now_s - LONG_AGO_S},
        "sent_in_the_future": {"sent_s": now_s + AHEAD_S},
    }
    fields = {"v": VERSION, "id": number, "op": "move", **valid, **changes[fault]}
    if fault == "missing_field":
        del fields["positions"]
    return json.dumps(fields).encode() + b"\n"


FAULTS: Final = SocketNonsense.model_fields["fault"].annotation.__args__  # type: ignore[union-attr]
"""Errors in messages, in the order of ``SocketNonsense``."""
