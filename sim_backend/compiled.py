"""Python functions made into machine code by numba, with their types kept for the type checker."""

from collections.abc import Callable
from typing import TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., object])


def compiled(function: Function) -> Function:
    """``function`` as machine code, kept on disk between runs. ``.py_func`` is the function as it was written."""
    return cast(Function, numba.njit(cache=True)(function))
