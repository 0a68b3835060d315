"""A process's way into the ROS graph, its waits there, and its way out of the graph in a limited time."""

import faulthandler
import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from math import inf
from time import monotonic
from typing import Final

import rclpy
from rclpy.exceptions import InvalidHandle, NameValidationException
from rclpy.executors import Executor
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from nodes.discovery import stay_on_this_machine, who_can_command
from nodes.ros_environment import RosError

EXIT_LIMIT_S: Final = 10.0
_TURN_S: Final = 0.1
MIXED_LIST: Final = "Sequence should be of same type"
"""What rcl says of a list with whole numbers among others."""


def init_rclpy(arguments: Sequence[str] | None = None) -> str:
    """Initialise rclpy with the discovery range of this process; returns in words who can command the arm.

    Signals stay the caller's: rclpy's own handlers close the middleware at once, and then no goal could be ended.
    Raises RosError.
    """
    stay_on_this_machine(os.environ)
    with rcl_errors():
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    return who_can_command(os.environ)


@contextmanager
def rcl_errors() -> Iterator[None]:
    """Raise what rcl refuses as RosError, without the places in rcl's own source. A defect of ours passes."""
    try:
        yield
    except (RuntimeError, NameValidationException) as error:
        if not _refused(error):
            raise
        reason = " ".join(re.sub(r", at /[^,]*", "", str(error)).rstrip("^ \n").split())
        remedy = "; write each number of the list with a decimal point" if MIXED_LIST in reason else ""
        raise RosError(f"ROS 2 does not start: {reason}{remedy}") from error


def _refused(error: Exception) -> bool:
    """Whether rcl raised it of a setting, a parameter or a name; rclpy has no public name for such errors."""
    return type(error).__module__.startswith("rclpy.") and not isinstance(error, InvalidHandle | NotImplementedError)


def spin_until_done(executor: Executor, future: Future, timeout_s: float | None = None) -> bool:
    """Serve an executor until the future is done, by something that it serves; whether it is, within the time.

    rclpy's own ``spin_until_future_complete`` hangs one more callback on the future for every event that it serves, and
    makes a task of each in the end: a node that was up for a day has millions, and a burst of answers takes minutes.
    Every turn is as long as the last: rclpy begins anew with its tasks otherwise, and one that waits starves the rest.
    """
    end_s, turn_s = (inf, None) if timeout_s is None else (monotonic() + timeout_s, _TURN_S)
    while not future.done() and monotonic() < end_s:
        executor.spin_once(timeout_sec=turn_s)
    return bool(future.done())


@contextmanager
def exit_watchdog(seconds: float = EXIT_LIMIT_S) -> Iterator[None]:
    """End the process where the body takes longer, with status 1 and a traceback that says where it hung.

    Fast DDS (2.14) can wait for itself for ever where two participants leave in the same instant, as at a Ctrl-C for a
    whole launch file: ``DomainParticipant::set_listener`` holds the lock that it waits for. The interpreter's own lock
    may be held meanwhile, so this is a thread in C.
    """
    faulthandler.dump_traceback_later(seconds, exit=True)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()
