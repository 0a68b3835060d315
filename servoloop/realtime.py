"""Real-time priority for what must be on time, where the system grants it."""

import logging
import os

LOG = logging.getLogger("servoloop")

PRIORITY = 10


def claim_realtime_priority() -> bool:
    """Let this process run before ordinary ones; whether it was granted.

    The whole process and not one thread: a thread of high priority that waits for the interpreter's lock
    is only as fast as the thread that holds it.
    """
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(PRIORITY))
    except PermissionError:
        LOG.info("no real-time priority (a limit 'rtprio' of %d would allow it): ordinary timing", PRIORITY)
        return False
    return True
