"""Write result files, and check before a run that they can be written."""

import tempfile
from pathlib import Path

from commissioning.atomic_write import cannot_write, write_whole
from drivers.errors import DriverError


def make_folder(folder: Path) -> None:
    """Create a folder for results if necessary. Raises DriverError if the folder is not writable."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DriverError(f"cannot write into {folder}: {error.strerror}") from error
    require_writable(folder)


def require_file(path: Path) -> None:
    """Raise DriverError if a file cannot be written at ``path``. Call this function before a run, not only at its
    end."""
    if path.is_dir():
        raise DriverError(f"{path} is a folder: choose the name of a file")
    if path.exists() and not path.is_file():
        raise DriverError(f"{path} is not a regular file: choose another path")
    require_writable(path.parent)


def write_file(path: Path, content: str | bytes, keep: bool = True) -> None:
    """Write a file. If ``keep`` is true, first rename any existing file to NAME.1. Raises DriverError."""
    try:
        write_whole(path, content, keep)
    except OSError as error:
        raise DriverError(cannot_write(path, error)) from error


def require_writable(folder: Path) -> None:
    """Raise DriverError if a folder is not writable. Call this function before a run, not only at its end."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise DriverError(f"cannot write into {folder}: {error.strerror}") from error
