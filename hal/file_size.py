"""Size limits for files that are specified by a user or by another file."""

import stat
from contextlib import suppress
from pathlib import Path
from typing import Final

LARGEST_BYTES: Final = 2_000_000
"""Maximum size of a text file. A URDF with a hundred joints is a tenth of this size."""
LARGEST_SHAPE_BYTES: Final = 20_000_000
"""Maximum size of a mesh or an image. A binary STL file of this size has 400,000 triangles."""
SHORTEN: Final = "shorten it, or choose another file"
REDUCE: Final = "reduce the number of its triangles or pixels"


def check_size(path: Path, error: type[Exception], largest_bytes: int = LARGEST_BYTES, remedy: str = SHORTEN) -> None:
    """Check that a file is a regular file of limited size, before another library reads it.

    Args:
        path: The file.
        error: Class of the error to raise.
        largest_bytes: Maximum size, in bytes.
        remedy: How to fix a file that is too large, for the message.

    Raises:
        error: The file is too large, or is a device or a pipe, which has no size.
        OSError: The file does not exist.
        ValueError: The path is not valid.
    """
    found = path.stat()
    if not stat.S_ISREG(found.st_mode):
        raise error(f"{path} is not a regular file: choose another file")
    if found.st_size > largest_bytes:
        raise error(too_large(path, largest_bytes, remedy))


def check_existing(path: Path, error: type[Exception]) -> None:
    """Check the size of a text file if it exists. A missing file is reported by the library that reads the file."""
    with suppress(OSError, ValueError):
        check_size(path, error)


def too_large(path: Path, largest_bytes: int = LARGEST_BYTES, remedy: str = SHORTEN) -> str:
    """Return the message for a file that is larger than ``largest_bytes``."""
    return f"{path} is larger than {largest_bytes / 1e6:g} MB: {remedy}"
