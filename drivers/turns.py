"""Transactions on several lines that overlap in time, in one thread.

A transaction is a generator: it writes its question, yields, and only then waits for the answer. While one
line is waited for, the bytes of the others gather in the kernel.
"""

from collections.abc import Generator, Sequence
from typing import TypeVar

Result = TypeVar("Result")

Steps = Generator[None, None, Result]
"""Yields before each wait for the line; returns its result."""


def finish(steps: Steps[Result]) -> Result:
    """One transaction by itself."""
    try:
        while True:
            next(steps)
    except StopIteration as end:
        result: Result = end.value
        return result


def overlapped(transactions: Sequence[Steps[Result]]) -> Steps[list[Result]]:
    """All of them, step by step in turns; their results in the order given.

    An exception of one ends them all: it is raised here, and the others are closed.
    """
    results: dict[int, Result] = {}
    try:
        while True:
            for index, steps in enumerate(transactions):
                if index not in results:
                    try:
                        next(steps)
                    except StopIteration as end:
                        results[index] = end.value
            if len(results) == len(transactions):
                return [results[index] for index in range(len(transactions))]
            yield
    finally:
        for steps in transactions:
            steps.close()
