"""Store the machine code of compiled functions on disk, if possible."""

import logging
from collections.abc import Callable
from functools import cache
from typing import TypeVar

LOG = logging.getLogger("servoloop")
Function = TypeVar("Function", bound=Callable[..., object])


def with_cache(compile_function: Callable[[bool], Function]) -> Function:
    """Compile a function with numba, and cache its machine code on disk.

    Without a writable folder for the cache, the function is compiled in every process. This is the case if root has
    installed servoloop, and a user without a home folder runs it.

    Args:
        compile_function: Function that compiles with the given value of numba's option ``cache``.
    """
    try:
        return compile_function(True)
    except RuntimeError:
        _report_no_cache()
        return compile_function(False)


@cache
def _report_no_cache() -> None:
    LOG.warning(
        "compiled functions cannot be stored, so every start takes longer: set NUMBA_CACHE_DIR to a writable folder"
    )
