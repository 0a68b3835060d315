"""Report errors of a stack as LeRobot's errors."""

from collections.abc import Iterator
from contextlib import contextmanager

from lerobot.utils.errors import DeviceNotConnectedError

from lerobot_servoloop.connection import StackError


@contextmanager
def connecting() -> Iterator[None]:
    """Report every StackError as DeviceNotConnectedError."""
    try:
        yield
    except StackError as error:
        raise DeviceNotConnectedError(str(error)) from error


@contextmanager
def connected() -> Iterator[None]:
    """Report the end of a connection as DeviceNotConnectedError. Other errors are still raised as StackError."""
    try:
        yield
    except StackError as error:
        if error.kind not in ("ended", "timeout"):
            raise
        raise DeviceNotConnectedError(str(error)) from error
