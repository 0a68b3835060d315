"""The option ``--record``, and the check of its file before anything moves."""

from pathlib import Path
from typing import Annotated, Final

import typer

from drivers.errors import DriverError

SUFFIX: Final = ".mcap"
"""Programs know the format by it."""
RecordOption = Annotated[
    Path | None, typer.Option("--record", metavar="FILE.mcap", help="Record every cycle and all bus traffic.")
]


class RecordingError(DriverError):
    """A recording cannot be written or read."""


def check_path(path: Path) -> None:
    """Check that a recording can begin there. Raises RecordingError."""
    if path.suffix != SUFFIX:
        raise RecordingError(f"a recording is a file whose name ends in {SUFFIX}, not {path}")
    if path.exists():
        raise RecordingError(f"{path} is there already: name another file, or delete it")
    if not path.parent.is_dir():
        raise RecordingError(f"there is no folder {path.parent} to record into: make it first")
