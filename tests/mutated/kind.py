"""Kinds of user files: good examples, and the functions with which commands read them."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.robot_files import Files

SO101: Final = "so101"


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of file: its file name, good examples, and the reader of the folder that contains it."""

    name: str
    good: Callable[[], list[bytes]]
    read: Callable[[Path], None]
    beside: Callable[[Path], None] = lambda folder: None
    """Function that writes the other files that the folder must contain."""


def of_paths(*paths: Path) -> Callable[[], list[bytes]]:
    """Return a function that reads the good files at these paths."""
    return lambda: [path.read_bytes() for path in paths]


@cache
def files_of(arm: str) -> Files:
    """Read the files of an arm only once."""
    return read_arm_files(find_arm(arm))
