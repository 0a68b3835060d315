"""A virtual bus on a pseudo-terminal, served by a thread of the test's process."""

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
    """Serve the bus at ``link`` until the end of the context, and yield the name of the port."""
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
    """Poll until ``what()`` is true. The timeout is only needed on a very busy machine."""
    deadline_s = time.monotonic() + within_s
    while not what():
        assert time.monotonic() < deadline_s, "waited in vain"
        time.sleep(0.01)
