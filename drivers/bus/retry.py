"""A question is asked again, for one lost packet must not fail a whole set-up, and a cycle has time for some."""

from collections.abc import Callable
from typing import Final, TypeVar

from drivers.errors import ServoCorrupt, ServoSilent

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
