"""What the benches take on their command lines. The parser says in a sentence what it does not."""

import argparse
from pathlib import Path


def positive(text: str) -> int:
    """A whole number from 1 on."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is no whole number from 1 on")
    return int(text)


def free_path(text: str) -> Path:
    """Where a link may be put; one of a former run may be there still."""
    path = Path(text)
    if path.exists() and not path.is_symlink():
        raise argparse.ArgumentTypeError(f"{path} exists and is no link: choose another path")
    return path


def silence(text: str) -> tuple[int, float, float]:
    """``ID,FROM,TO``: who is silent, between which two times (s) after the start."""
    try:
        servo_id, from_s, to_s = text.split(",")
        return int(servo_id), float(from_s), float(to_s)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no ID with two times in seconds, such as 3,1,2.5") from None
