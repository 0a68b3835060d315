"""The limits of files that are read because a user or another file names them."""

import stat
from contextlib import suppress
from pathlib import Path
from typing import Final

LARGEST_BYTES: Final = 2_000_000
"""Maximum size of a text file; a robot description of a hundred joints has a tenth of it."""
LARGEST_SHAPE_BYTES: Final = 20_000_000
"""Maximum size of a mesh or a picture, which has 400,000 triangles as binary STL."""
SHORTEN: Final = "shorten it, or choose another file"
REDUCE: Final = "reduce the number of its triangles or pixels"


def check_size(path: Path, error: type[Exception], largest_bytes: int = LARGEST_BYTES, remedy: str = SHORTEN) -> None:
    """Check a file that another library is to read.

    Raises:
        error: The file is too large, or a device or a pipe, which has no size. The message has file and remedy.
        OSError, ValueError: There is no such file, and there cannot be one of this name.
    """
    found = path.stat()
    if not stat.S_ISREG(found.st_mode):
        raise error(f"{path} is not a regular file: choose another file")
    if found.st_size > largest_bytes:
        raise error(too_large(path, largest_bytes, remedy))


def check_existing(path: Path, error: type[Exception]) -> None:
    """Check a text file as ``check_size`` does, if it exists: the library that reads it reports a missing one."""
    with suppress(OSError, ValueError):
        check_size(path, error)


def too_large(path: Path, largest_bytes: int = LARGEST_BYTES, remedy: str = SHORTEN) -> str:
    """The message about a file that is larger than ``largest_bytes``."""
    return f"{path} is larger than {largest_bytes / 1e6:g} MB: {remedy}"
