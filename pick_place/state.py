"""Format the messages of ``/sorting/arm/state``. The module imports no ROS package."""

import json

from pick_place.job import State


def state_json(seq: int, time_s: float, state: State) -> str:
    """Format a state as JSON. ``seq`` counts the states, starting at 1. ``ts`` is the time on the node's clock, in
    seconds since 1970."""
    return json.dumps(
        {
            "seq": seq,
            "request_id": state.request_id,
            "ts": round(time_s, 6),
            "phase": state.phase,
            "ok": state.ok,
            "message": state.message,
            "grade": state.grade,
        }
    )
