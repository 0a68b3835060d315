"""Compile Python functions to machine code with numba, and keep their types for the type checker."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final, TypeVar, cast

import numba
from numba.core import event

from hal.compile_cache import with_cache

Function = TypeVar("Function", bound=Callable[..., object])

COMPILES: Final = "numba:compile"
"""Event that numba emits when it begins to compile. Loading a function from the cache does not emit the event."""
COMPILING: Final = "compiling the simulation into machine code; this happens once per installation and takes about 20 s"


def compiled(function: Function) -> Function:
    """Compile ``function`` and cache its machine code on disk. The result's ``.py_func`` is the original function."""
    return cast(Function, with_cache(lambda cache: numba.njit(cache=cache)(function)))


class _Announcement(event.Listener):
    """Listener that calls a function at the first event."""

    def __init__(self, announce: Callable[[str], None]) -> None:
        self._announce = announce
        self._done = False

    def on_start(self, event: Any) -> None:
        if not self._done:
            self._done = True
            self._announce(COMPILING)

    def on_end(self, event: Any) -> None: ...


@contextmanager
def compilation_announced(announce: Callable[[str], None]) -> Iterator[None]:
    """Within the block, announce the first compilation, if there is one."""
    with event.install_listener(COMPILES, _Announcement(announce)):
        yield
