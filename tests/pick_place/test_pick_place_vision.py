"""Choice of the apple, age of vision messages, and JSON of a state."""

import json

import pytest

from pick_place.job import JobPhase, State
from pick_place.state import state_json
from pick_place.vision import candidate, reason_not_fresh


@pytest.mark.parametrize(
    ("grades", "expected"),
    [
        ([], None),
        (["", "  "], None),
        (["B"], "B"),
        (["", " c ", "A"], "C"),
    ],
)
def test_first_apple_with_a_grade_is_chosen(grades: list[str], expected: str | None) -> None:
    assert candidate(grades) == expected


@pytest.mark.parametrize(
    ("stamp_s", "word"),
    [
        (100.0, None),
        (99.01, None),
        (100.5, None),
        (99.0, "old"),
        (0.0, "no stamp"),
        (101.0, "future"),
    ],
)
def test_message_is_fresh_for_less_than_a_second(stamp_s: float, word: str | None) -> None:
    reason = reason_not_fresh(stamp_s, 100.0, 1.0)
    assert (reason is None) if word is None else (reason is not None and word in reason)


def test_state_is_formatted_as_json() -> None:
    state = State(3, "B", JobPhase.ERROR, "canceled")
    assert json.loads(state_json(12, 1.5, state)) == {
        "seq": 12,
        "request_id": 3,
        "ts": 1.5,
        "phase": "error",
        "ok": False,
        "message": "canceled",
        "grade": "B",
    }
