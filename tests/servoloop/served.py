"""A virtual line on a pseudo-terminal, served by a thread of the test's own process."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sim_backend.emulator import serve
from sim_backend.line.line import ServoLine


@contextmanager
def served(line: ServoLine[Any], link: Path, on_tick: Callable[[float], None] | None = None) -> Iterator[str]:
    """Serve the line at ``link`` for as long as the context lasts; the port's name."""
    ended, ready = threading.Event(), threading.Event()
    thread = threading.Thread(
        target=serve, args=(line, link), kwargs={"stop": ended.is_set, "on_tick": on_tick, "on_ready": ready.set}
    )
    thread.start()
    try:
        assert ready.wait(20.0)
        yield str(link)
    finally:
        ended.set()
        thread.join(20.0)


def eventually(what: Callable[[], object], within_s: float = 20.0) -> None:
    """Poll until ``what()`` is true. The limit is for a machine in trouble, not a measurement."""
    deadline_s = time.monotonic() + within_s
    while not what():
        assert time.monotonic() < deadline_s, "waited in vain"
        time.sleep(0.01)
