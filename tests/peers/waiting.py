"""Helpers for clients that send each request only once, on a machine that may delay replies."""

import time
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def eventually(what: Callable[[], object], within_s: float = 20.0) -> None:
    """Poll until ``what()`` returns True. The timeout only ends a test that fails; it is not a measurement."""
    deadline_s = time.monotonic() + within_s
    while not what():
        assert time.monotonic() < deadline_s, "waited in vain"
        time.sleep(0.01)
