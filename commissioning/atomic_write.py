"""Write files atomically: write a temporary file, rename it, and keep the previous version."""

import os
from pathlib import Path


def write_whole(path: Path, content: str | bytes, keep: bool = True) -> None:
    """Write a file atomically, and keep its previous content in ``path``.1. Raises OSError.

    If the program is interrupted at any time, ``path`` contains either the complete previous or the complete new
    content. If ``keep`` is False, ``path``.1 remains unchanged.
    """
    if keep and path.exists():
        _put(path.with_name(path.name + ".1"), path.read_bytes())
    _put(path, content.encode() if isinstance(content, str) else content)


def cannot_write(path: Path, error: OSError) -> str:
    """Return the error message for a failed ``write_whole``."""
    kept = ". The previous file is unchanged" if path.is_file() else ""
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
