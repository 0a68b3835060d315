"""Real-time priority for what must be on time, where the system grants it."""

import logging
import os

LOG = logging.getLogger("servoloop")

PRIORITY = 10
LOOP_PRIORITY = 11


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
