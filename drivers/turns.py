"""Transactions on several lines that overlap in time, in one thread.

A transaction is a generator: it writes its question, yields, and only then waits for the answer. While one
line is waited for, the bytes of the others gather in the kernel. So whose answer is all that there is to come
can wait, and a line on which the next question depends on the answer has the first turn.
"""

from collections.abc import Generator, Sequence
from enum import IntEnum
from typing import TypeVar

Result = TypeVar("Result")


class Wait(IntEnum):
    """What is waited for; the lower, the sooner its turn."""

    NEXT = 0
    """An answer that will come, before the next question can be asked."""
    LAST = 1
    """All that there is to come. A dead line takes its whole time here, and the others' bytes wait meanwhile."""
    DOUBTFUL = 2
    """An answer of one who may be silent, or has just been."""


Steps = Generator[Wait | None, None, Result]
"""Yields before each wait for the line what it is for (None is ``LAST``); returns its result."""


def finish(steps: Steps[Result]) -> Result:
    """One transaction by itself."""
    try:
        while True:
            next(steps)
    except StopIteration as end:
        result: Result = end.value
        return result


def overlapped(transactions: Sequence[Steps[Result]]) -> Steps[list[Result]]:
    """All of them: first every question, then step by step as ``Wait`` says; their results in the order given.

    An exception of one ends them all: it is raised here, and the others are closed.
    """
    results: dict[int, Result] = {}
    waits = dict.fromkeys(range(len(transactions)), Wait.NEXT)
    try:
        while waits:
            foremost = min(waits.values())
            for index in [index for index, wait in waits.items() if wait is foremost]:
                try:
                    said = next(transactions[index])
                    waits[index] = Wait.LAST if said is None else said
                except StopIteration as end:
                    results[index] = end.value
                    del waits[index]
            if waits:
                yield min(waits.values())
        return [results[index] for index in range(len(transactions))]
    finally:
        for steps in transactions:
            steps.close()
