"""Store the machine code of compiled functions on disk, if possible."""

import logging
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from typing import Any, TypeVar

LOG = logging.getLogger("servoloop")
Function = TypeVar("Function", bound=Callable[..., object])


def with_cache(compile_function: Callable[[bool], Function]) -> Function:
    """Compile a function with numba, and cache its machine code on disk.

    Without a writable folder for the cache, the function is compiled in every process. This is the case if root has
    installed servoloop, and a user without a home folder runs it, or if the disk is full.

    Args:
        compile_function: Function that compiles with the given value of numba's option ``cache``.
    """
    try:
        function: Any = compile_function(True)
    except RuntimeError:
        _report_no_cache("no folder is writable")
        return compile_function(False)
    if hasattr(function, "_cache"):  # numba returns the original function if compilation is disabled
        function._cache = _OptionalCache(function._cache)
    found: Function = function
    return found


class _OptionalCache:
    """Cache of one function, which numba uses at the first call. An error of the disk is reported but not raised."""

    def __init__(self, inner: Any) -> None:
        """``inner`` is numba's cache of the function."""
        self._inner = inner

    def load_overload(self, signature: Any, target: Any) -> Any:
        """Return the stored machine code for the types of the arguments, or None if there is none."""
        with self._errors_reported():
            return self._inner.load_overload(signature, target)
        return None

    def save_overload(self, signature: Any, machine_code: Any) -> None:
        """Store the machine code for the types of the arguments."""
        with self._errors_reported():
            self._inner.save_overload(signature, machine_code)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)

    @contextmanager
    def _errors_reported(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            _report_no_cache(error.strerror or str(error))
            # The index may already refer to machine code that could not be stored. A file with the same name may
            # contain the machine code of an older source.
            with suppress(OSError):
                os.unlink(self._inner._cache_file._index_path)


@cache
def _report_no_cache(reason: str) -> None:
    LOG.warning(
        "the cache of compiled functions cannot be used (%s), so every start takes longer: set NUMBA_CACHE_DIR to a "
        "writable folder with free space",
        reason,
    )
