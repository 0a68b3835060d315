"""Start rclpy in a process, wait for futures, and leave the ROS graph within a limited time."""

import argparse
import faulthandler
import os
import re
import sys
from collections.abc import Callable, Coroutine, Iterator, Sequence
from contextlib import contextmanager
from math import inf
from time import monotonic, sleep
from typing import Any, Final

import rclpy
from rclpy.exceptions import InvalidHandle, NameValidationException
from rclpy.executors import Executor
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.utilities import remove_ros_args

from nodes.discovery import describe_access, open_to_network, stay_on_this_machine
from nodes.namespace import namespace_arguments
from nodes.ros_environment import RosError

EXIT_LIMIT_S: Final = 10.0
STOP_LIMIT_S: Final = 30.0
"""Maximum time to stop the arm after an exception in a callback, in seconds."""
STDERR: Final = 2
"""File descriptor of standard error. ``sys.stderr`` may be replaced by an object that has no file descriptor."""
_TURN_S: Final = 0.1
_PAUSE_S: Final = 0.01
"""Pause after an exception of the executor, in seconds. If every turn fails, it limits the use of the processor."""
MIXED_LIST: Final = "Sequence should be of same type"
"""Error message from rcl for a parameter list that mixes integers and decimal numbers."""


def init_rclpy(arguments: Sequence[str] | None = None, namespace: str = "") -> str:
    """Initialize rclpy, and set the discovery range of this process.

    The caller remains responsible for signal handling, because rclpy's handlers would close the middleware immediately,
    before running goals can finish.

    Args:
        arguments: Arguments in the form of ``sys.argv``, which is the default.
        namespace: Namespace of all nodes in this process, or empty if the arguments may specify it.

    Returns:
        A sentence that states which programs can command the arm.

    Raises:
        RosError: rcl rejects a setting or an argument.
    """
    stay_on_this_machine(os.environ)
    with rcl_errors():
        given = sys.argv if arguments is None else arguments
        rclpy.init(args=[*given, *namespace_arguments(namespace)], signal_handler_options=SignalHandlerOptions.NO)
    return describe_access(os.environ)


def read_network_option(args: Sequence[str], name: str, description: str, network: str) -> None:
    """Read the ``--network`` option of a node's process. If it is given, make the process reachable from other
    machines. An unknown argument ends the process with status 2.

    Args:
        args: Arguments in the form of ``sys.argv``.
        name: Name of the node, for the help text.
        description: Purpose of the node, for the help text.
        network: Help text of the option.

    Raises:
        RosError: rcl rejects a ROS argument.
    """
    parser = argparse.ArgumentParser(name, description=f"{description} ROS arguments follow --ros-args.")
    parser.add_argument("--network", action="store_true", help=network)
    with rcl_errors():
        options, unknown = parser.parse_known_args(remove_ros_args(args)[1:])
    if unknown:
        parser.error(f"unknown arguments: {' '.join(unknown)} (parameters and other ROS arguments follow --ros-args)")
    if options.network:
        open_to_network(os.environ)


@contextmanager
def rcl_errors() -> Iterator[None]:
    """Convert rcl errors to RosError, without the source file positions. Other errors are passed on unchanged."""
    try:
        yield
    except (RuntimeError, NameValidationException) as error:
        if not _refused(error):
            raise
        reason = " ".join(re.sub(r", at /[^,]*", "", str(error)).rstrip("^ \n").split())
        remedy = "; write each number of the list with a decimal point" if MIXED_LIST in reason else ""
        raise RosError(f"ROS 2 does not start: {reason}{remedy}") from error


def _refused(error: Exception) -> bool:
    """Return whether rcl rejected a setting, parameter or name. rclpy has no public base class for such errors."""
    return type(error).__module__.startswith("rclpy.") and not isinstance(error, InvalidHandle | NotImplementedError)


def spin_until_done(executor: Executor, future: Future, timeout_s: float | None = None) -> bool:
    """Spin an executor until a future is done or the timeout has passed, and return whether the future is done.

    rclpy's ``spin_until_future_complete`` adds a callback to the future for every event that it handles, and finally
    turns each callback into a task. After a day, a node then has millions of tasks, and a burst of responses takes
    minutes. All iterations use the same timeout, because rclpy restarts its task queue when the timeout changes. With
    different timeouts, a waiting task would block the other tasks.
    """
    end_s, turn_s = (inf, None) if timeout_s is None else (monotonic() + timeout_s, _TURN_S)
    while not future.done() and monotonic() < end_s:
        executor.spin_once(timeout_sec=turn_s)
    return bool(future.done())


def spin_until_stopped(executor: Executor, stopped: Future, stop: Callable[[], Coroutine[Any, Any, None]]) -> None:
    """Spin the executor of a node that moves an arm until ``stopped`` is done.

    If a callback raises an exception, ``stop`` runs before the exception is raised, so that no motion continues without
    its node. Other exceptions are ignored in the meantime. If the context has ended, nothing can be stopped over ROS.
    """
    try:
        spin_until_done(executor, stopped)
    except Exception:
        if executor.context.ok():
            _finish(executor, executor.create_task(stop))
        raise


def _finish(executor: Executor, task: Future) -> None:
    """Spin until a task is done, the context has ended or the time limit has passed. Ignore exceptions of callbacks."""
    end_s = monotonic() + STOP_LIMIT_S
    while not task.done() and monotonic() < end_s and executor.context.ok():
        try:
            spin_until_done(executor, task, end_s - monotonic())
        except Exception:
            sleep(_PAUSE_S)


@contextmanager
def exit_watchdog(seconds: float = EXIT_LIMIT_S) -> Iterator[None]:
    """Terminate the process with status 1 and a traceback if the body takes longer than ``seconds``.

    Fast DDS (2.14) can deadlock if two participants leave at the same time, for example after Ctrl-C in a launch file.
    ``DomainParticipant::set_listener`` then waits for a lock that it already holds. Because the GIL may be held during
    the deadlock, the watchdog is a thread in C.
    """
    faulthandler.dump_traceback_later(seconds, exit=True, file=STDERR)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()
