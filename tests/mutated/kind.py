"""A kind of file that users write: good ones, and what the commands do with them before anything moves."""

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
    """A kind of file: its name in a folder of its own, the good files, and the reader of that folder."""

    name: str
    good: Callable[[], list[bytes]]
    read: Callable[[Path], None]
    beside: Callable[[Path], None] = lambda folder: None
    """Writes what must be beside the file."""


def of_paths(*paths: Path) -> Callable[[], list[bytes]]:
    """The good files at these paths."""
    return lambda: [path.read_bytes() for path in paths]


@cache
def files_of(arm: str) -> Files:
    """The files of an arm, read once."""
    return read_arm_files(find_arm(arm))
