"""Compile Python functions to machine code with numba, and keep their types for the type checker."""

from collections.abc import Callable
from typing import TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., object])


def compiled(function: Function) -> Function:
    """Compile ``function`` and cache its machine code on disk. The first call in an installation takes seconds."""
    return cast(Function, numba.njit(cache=True, error_model="numpy")(function))
