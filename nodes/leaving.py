"""Leaving the ROS graph, in a limited time."""

import faulthandler
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

LEAVE_S: Final = 10.0


@contextmanager
def leaving(seconds: float = LEAVE_S) -> Iterator[None]:
    """What takes longer ends the process, with status 1 and a traceback that says where it hung.

    Fast DDS (2.14) can wait for itself for ever where two participants leave in the same instant, as at a Ctrl-C for a
    whole launch file: ``DomainParticipant::set_listener`` holds the lock that it waits for. The interpreter's own lock
    may be held meanwhile, so this is a thread in C.
    """
    faulthandler.dump_traceback_later(seconds, exit=True)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()
