"""What the system grants to those who must be on time: priority, and processors that do not sleep."""

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

LOG = logging.getLogger("servoloop")

PRIORITY = 10
LOOP_PRIORITY = 11
WAKE_LATENCY: Final = Path("/dev/cpu_dma_latency")
"""While it is open: how long a processor may take to wake up, written as a 32-bit number of microseconds
(Linux, Documentation/power/pm_qos_interface)."""


def claim_realtime_priority() -> bool:
    """Let this process run before ordinary ones; whether it was granted. Threads that are there already stay as
    they are, so it comes before ROS, whose middleware has its own.

    The whole process and not one thread: a thread of high priority that waits for the interpreter's lock, or for
    the middleware's, is only as fast as the thread that holds it.
    """
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(PRIORITY))
    except PermissionError:
        LOG.info("no real-time priority (a limit 'rtprio' of %d would allow it): ordinary timing", LOOP_PRIORITY)
        return False
    return True


def put_first() -> None:
    """Let the calling thread run before the others of this process, where the process has real-time priority."""
    if os.sched_getscheduler(0) != os.SCHED_RR:
        return
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(LOOP_PRIORITY))
    except PermissionError:
        LOG.info("the control loop has no priority over this process' other threads (rtprio %d)", LOOP_PRIORITY)


@contextmanager
def processors_awake(device: Path = WAKE_LATENCY) -> Iterator[bool]:
    """Keep all processors out of their sleep states for a while; yields whether that was granted.

    For a loop as fast as its line: a sleeping processor takes tens of microseconds to wake up, a virtual one more, and
    forgets more. Not for a loop with a period, for meanwhile the processors spin. Ends with the process at the latest.
    """
    try:
        request = os.open(device, os.O_WRONLY)
    except OSError as error:
        LOG.warning("the processors may sleep while they wait for the line (%s): a cycle is longer by a wake-up", error)
        yield False
        return
    try:
        os.write(request, bytes(4))
        yield True
    finally:
        os.close(request)
