"""The benches' command lines: what they take, and how they end. What is wrong is said in a sentence."""

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from drivers.errors import DriverError
from hal.errors import HalError


@contextmanager
def in_words() -> Iterator[None]:
    """End a bench whose simulator has gone, or whose port is another's, without a traceback."""
    try:
        yield
    except (DriverError, HalError, OSError) as error:
        raise SystemExit(f"the bench ends: {error}") from None


def positive(text: str) -> int:
    """Parse a whole number from 1 on."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is no whole number from 1 on")
    return int(text)


def free_path(text: str) -> Path:
    """Parse a path at which a link may be put; one of a former run may be there still."""
    path = Path(text)
    if path.exists() and not path.is_symlink():
        raise argparse.ArgumentTypeError(f"{path} exists and is no link: choose another path")
    return path


def silence(text: str) -> tuple[int, float, float]:
    """Parse ``ID,FROM,TO``: the servo that is silent between two times (s) after the start."""
    try:
        servo_id, from_s, to_s = text.split(",")
        return int(servo_id), float(from_s), float(to_s)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no ID with two times in seconds, such as 3,1,2.5") from None
