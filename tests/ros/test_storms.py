"""Clients are killed, flood the stack or send invalid data. The arm holds its position and all other clients are
served.

Whether cycles are late during such a flood depends on the machine. ``python -m benchmarks.storms`` measures this at
full size.
"""

import threading
from collections.abc import Iterator

import pytest

from benchmarks import storms
from benchmarks.ros import stack
from benchmarks.storm_watch import StormWatch
from benchmarks.storms import STORMS, goals, run

pytestmark = pytest.mark.slow

SECONDS = 3.0


@pytest.fixture(scope="module")
def watch() -> Iterator[StormWatch]:
    with pytest.MonkeyPatch.context() as patch, stack():
        patch.setattr(storms, "CLIENTS", 8)
        watch = StormWatch()
        thread = threading.Thread(target=watch.run)
        thread.start()
        try:
            goals(0.0)  # initial position for every flood
            yield watch
        finally:
            watch.end()
            thread.join()


@pytest.mark.parametrize("name", [name for name in STORMS if name != "nothing"])
def test_arm_holds_and_cycles_continue_during_a_storm(watch: StormWatch, name: str) -> None:
    stamps_s, _, away_rad = run(name, SECONDS, watch)
    assert away_rad < 1e-3
    assert len(stamps_s) > 20
    assert stamps_s == sorted(stamps_s)
