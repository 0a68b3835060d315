"""A process asks the scheduler for priority, and to stay on its processor; the system may not grant it."""

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager

import psutil

LOG = logging.getLogger("servoloop")

PRIORITY = 10
LOOP_PRIORITY = 11


def claim_realtime_priority(priority: int = PRIORITY) -> bool:
    """Claim real-time priority for this process; whether it was granted. Threads that are there already stay as
    they are, so it comes before ROS, whose middleware has its own.

    The whole process and not one thread: a thread of high priority that waits for the interpreter's lock, or for
    the middleware's, is only as fast as the thread that holds it.
    """
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(priority))
    except PermissionError:
        LOG.info("no real-time priority (a limit 'rtprio' of %d would allow it): ordinary timing", LOOP_PRIORITY)
        return False
    return True


@contextmanager
def realtime_priority() -> Iterator[None]:
    """Have a loop's real-time priority where the system grants it, and what was there before afterwards; ordinary
    priority where that was more than the system grants now.

    For a program that computes long before or behind what it does in real time: at this priority it would keep the
    loops of other programs from the processor for as long. At ``PRIORITY`` it would share the processor with
    stacks that are starting, in turns of 0.1 s each, and servos that answer so late count as lost.
    """
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    claim_realtime_priority(LOOP_PRIORITY)
    try:
        yield
    finally:
        try:
            os.sched_setscheduler(0, *before)
        except PermissionError:
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def at_ordinary_priority() -> None:
    """Give up the real-time priority that this process has inherited."""
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def put_first() -> None:
    """Let the calling thread run before the others of this process, where the process has real-time priority."""
    if os.sched_getscheduler(0) != os.SCHED_RR:
        return
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(LOOP_PRIORITY))
    except PermissionError:
        LOG.info("the control loop has no priority over this process' other threads (rtprio %d)", LOOP_PRIORITY)


@contextmanager
def on_one_processor() -> Iterator[None]:
    """Keep the main thread, which calls this, on the processor on which it is, and whatever it starts meanwhile.

    For a loop of ordinary priority that does nothing but wait for a line. The system wakes it wherever there is
    room, in every other cycle on another processor, whose caches know nothing of it. Not for a loop with other
    threads beside it: it may have to wait for its one processor while another is free.
    """
    allowed = os.sched_getaffinity(0)
    try:
        os.sched_setaffinity(0, {psutil.Process().cpu_num()})
    except OSError as error:
        LOG.info("the loop may be moved from one processor to another: %s", error)
        yield
        return
    try:
        yield
    finally:
        os.sched_setaffinity(0, allowed)
