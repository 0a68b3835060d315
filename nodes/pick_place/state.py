"""The text of ``/sorting/arm/state``. No ROS."""

import json

from nodes.pick_place.job import State


def state_json(seq: int, time_s: float, state: State) -> str:
    """``seq`` counts states from 1; ``ts`` is the node's time in seconds (since 1970)."""
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
