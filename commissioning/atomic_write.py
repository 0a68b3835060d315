"""Write result files atomically and keep the previous version, and check before a run that they can be written."""

import errno
import os
import tempfile
from pathlib import Path

from drivers.driver_errors import DriverError


def write_whole(path: Path, content: str | bytes, keep: bool = True) -> None:
    """Write a file atomically, and keep its previous content in ``path``.1. Raises OSError.

    If the program is interrupted at any time, ``path`` contains either the complete previous or the complete new
    content. If ``keep`` is False, ``path``.1 remains unchanged. A pipe or a device is refused: it would be replaced by
    a file, and a read from it could wait forever.
    """
    if _is_special(path):
        raise OSError(errno.EINVAL, "Not a regular file", str(path))
    if keep and path.exists():
        _put(path.with_name(path.name + ".1"), path.read_bytes())
    _put(path, content.encode() if isinstance(content, str) else content)


def cannot_write(path: Path, error: OSError) -> str:
    """Return the error message for a failed ``write_whole``."""
    kept = ". The previous file is unchanged" if path.is_file() else ""
    return f"cannot write {path}: {error.strerror or error}{kept}"


def _is_special(path: Path) -> bool:
    """Return whether the path is a pipe, a device or a socket."""
    return path.exists() and not path.is_file() and not path.is_dir()


def _put(path: Path, content: bytes) -> None:
    partial = path.with_name(path.name + ".part")
    try:
        with partial.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(partial, path)
    except OSError:
        partial.unlink(missing_ok=True)
        raise


def make_folder(folder: Path) -> None:
    """Create a folder for results if necessary. Raises DriverError if the folder is not writable."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DriverError(f"cannot write into {folder}: {error.strerror}") from error
    require_writable(folder)


def require_file(path: Path, *suffixes: str) -> None:
    """Raise DriverError if a file cannot be written at ``path``, or if its name does not end in one of ``suffixes``.

    Call this function before a long run, so that the run does not fail only when it writes its result.
    """
    if path.is_dir():
        raise DriverError(f"{path} is a folder: choose the name of a file")
    if _is_special(path):
        raise DriverError(f"{path} is not a regular file: choose another path")
    if suffixes and path.suffix.lower() not in suffixes:
        raise DriverError(f"{path} does not end in {' or '.join(suffixes)}: choose such a name for the file to write")
    require_writable(path.parent)


def require_output(path: Path, source: Path, *suffixes: str) -> None:
    """Raise DriverError if a file cannot be written at ``path``, or if ``path`` is the file that the command reads."""
    require_file(path, *suffixes)
    if path.exists() and source.exists() and path.samefile(source):
        raise DriverError(f"{path} is the file that this command reads: choose another file to write")


def write_file(path: Path, content: str | bytes, keep: bool = True) -> None:
    """Write a file. If ``keep`` is true, first rename any existing file to NAME.1. Raises DriverError."""
    try:
        write_whole(path, content, keep)
    except OSError as error:
        raise DriverError(cannot_write(path, error)) from error


def require_writable(folder: Path) -> None:
    """Raise DriverError if a folder is not writable. Call this function before a long run, as with ``require_file``."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise DriverError(f"cannot write into {folder}: {error.strerror}") from error
