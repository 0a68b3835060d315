"""Fixtures of the tests of the page."""

import fcntl
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest


@pytest.fixture
def one_browser() -> Iterator[None]:
    """Allow only one test of this user at a time to use a browser, because software rendering uses all processors."""
    with (Path(tempfile.gettempdir()) / f"servoloop-tests-of-{os.getuid()}-browser.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield
