"""Paths of files and devices."""

import os
from pathlib import Path


def resolved(path: Path | str) -> Path:
    """Return an absolute path without symbolic links.

    Unlike ``Path.resolve``, this function accepts a loop of symbolic links. Opening such a path raises OSError.
    """
    return Path(os.path.realpath(path))
