"""One lost packet must not fail a whole set-up: what is asked again, and how often. Never in a cycle."""

from collections.abc import Callable, Sequence
from typing import Final, TypeVar

from drivers.errors import ServoCorrupt, ServoError, ServoSilent

ATTEMPTS: Final = 4
"""On a line that loses 9 % of all answers, one question in 15000 stays open by chance; a set-up has about a hundred."""

Result = TypeVar("Result")


def tried(question: Callable[[], Result]) -> Result:
    """Its answer, or what the last attempt raised."""
    for _ in range(ATTEMPTS - 1):
        try:
            return question()
        except (ServoSilent, ServoCorrupt):
            continue
    return question()


def tried_with_each(servo_ids: Sequence[int], do: Callable[[int], None]) -> list[ServoError]:
    """``do`` for every servo, whatever the others answer; what failed."""
    failed: list[ServoError] = []
    for servo_id in servo_ids:
        try:
            do(servo_id)
        except ServoError as error:
            failed.append(error)
    return failed
