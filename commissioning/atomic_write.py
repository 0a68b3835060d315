"""Files that are whole at every moment: written beside and renamed, the former one kept."""

import os
from pathlib import Path


def write_whole(path: Path, content: str | bytes, keep: bool = True) -> None:
    """Make ``content`` the content of ``path``; what was there before stands in ``path``.1 then. Raises OSError.

    Whenever it is cut off, ``path`` has all of the former content or all of the new one. ``keep``: without it
    ``path``.1 stays as it is.
    """
    if keep and path.exists():
        _put(path.with_name(path.name + ".1"), path.read_bytes())
    _put(path, content.encode() if isinstance(content, str) else content)


def cannot_write(path: Path, error: OSError) -> str:
    """The failure of ``write_whole`` in words."""
    kept = ": the former one is there still" if path.is_file() else ""
    return f"cannot write {path}: {error.strerror or error}{kept}"


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
