"""A question is asked again, for one lost packet must not fail a whole set-up, and a cycle has time for some."""

from collections.abc import Callable, Sequence
from typing import Final, TypeVar

from drivers.errors import ServoCorrupt, ServoError, ServoSilent

ATTEMPTS: Final = 4
"""On a line that loses 9 % of all answers, one question in 15000 stays open by chance; a set-up has about a hundred."""

CYCLE_RETRIES: Final = 2
"""How often a servo is asked again within one cycle, if there is time."""

Result = TypeVar("Result")


def retry(question: Callable[[], Result]) -> Result:
    """The answer to the question, or what the last attempt raised."""
    for _ in range(ATTEMPTS - 1):
        try:
            return question()
        except (ServoSilent, ServoCorrupt):
            continue
    return question()


def failures_of_each(servo_ids: Sequence[int], do: Callable[[int], None]) -> list[ServoError]:
    """Call ``do`` for every servo, whatever the others answer; returns what failed."""
    failed: list[ServoError] = []
    for servo_id in servo_ids:
        try:
            do(servo_id)
        except ServoError as error:
            failed.append(error)
    return failed
