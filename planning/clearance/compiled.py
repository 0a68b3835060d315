"""Compile Python functions to machine code with numba, and keep their types for the type checker."""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Final, TypeVar, cast

import numba

from hal.compile_cache import with_cache

Function = TypeVar("Function", bound=Callable[..., object])
KEY_FILE: Final = "sources.sha256"
"""Name of the file in ``__pycache__`` that contains a hash of the sources of the folder's machine code."""


def compiled(function: Function) -> Function:
    """Compile ``function`` and cache its machine code on disk. The first call after installation takes several seconds.

    The function releases the GIL, so that a control loop in the same process can keep its period.
    """
    return cast(Function, with_cache(lambda cache: numba.njit(cache=cache, nogil=True, error_model="numpy")(function)))


def remove_stale(folder: Path) -> None:
    """Remove a folder's machine code if one of its sources has changed.

    A function's machine code includes the functions that it calls, but numba checks only the function's own source
    file. A folder that is not writable belongs to an installed package, whose sources do not change.
    """
    key = hashlib.sha256(b"".join(path.read_bytes() for path in sorted(folder.glob("*.py")))).hexdigest()
    cache = folder / "__pycache__"
    known = cache / KEY_FILE
    if known.is_file() and known.read_text() == key:
        return
    try:
        cache.mkdir(exist_ok=True)
        for index in cache.glob("*.nbi"):
            index.unlink(missing_ok=True)
        known.write_text(key)
    except OSError:
        return


remove_stale(Path(__file__).parent)
