"""What the tests of the page share."""

import fcntl
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest


@pytest.fixture
def one_browser() -> Iterator[None]:
    """No other test of this user draws in a browser meanwhile: without a graphics card it takes all processors."""
    with (Path(tempfile.gettempdir()) / f"servoloop-tests-of-{os.getuid()}-browser.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield
