"""The log is switched off while campaigns run."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def quiet() -> Iterator[None]:
    """Nothing is logged while the context lasts."""
    former = logging.root.manager.disable
    silence()
    try:
        yield
    finally:
        logging.disable(former)


def silence() -> None:
    """What thousands of arms log about their faults is nobody's concern."""
    logging.disable(logging.CRITICAL)
