"""Command-line arguments of the benchmarks, and error messages without tracebacks."""

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from drivers.driver_errors import DriverError
from hal.hal_errors import HalError


@contextmanager
def in_words() -> Iterator[None]:
    """End a benchmark with one sentence instead of a traceback if its simulator exits or its port fails."""
    try:
        yield
    except (DriverError, HalError, OSError) as error:
        raise SystemExit(f"the benchmark ends: {error}") from None


def positive(text: str) -> int:
    """Parse an integer of at least 1."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number of at least 1, not {text!r}")
    return int(text)


def free_path(text: str) -> Path:
    """Parse a path for a new link. A link from an earlier run may still exist at the path."""
    path = Path(text)
    if path.exists() and not path.is_symlink():
        raise argparse.ArgumentTypeError(f"{path} exists and is not a symbolic link: choose another path")
    return path


def silence(text: str) -> tuple[int, float, float]:
    """Parse ``ID,FROM,TO``: a servo ID, and the start and end of its silence, in seconds after the start."""
    try:
        servo_id, from_s, to_s = text.split(",")
        return int(servo_id), float(from_s), float(to_s)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"must be a servo ID and two times in seconds, such as 3,1,2.5, not {text!r}"
        ) from None
