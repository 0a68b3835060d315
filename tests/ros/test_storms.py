"""Clients that are killed, that flood, that talk nonsense: the arm stays where it was and everybody else is served.

Whether cycles come late meanwhile depends on the machine: ``python -m benchmarks.storms`` measures that, at full size.
"""

import threading
from collections.abc import Iterator

import pytest

pytest.importorskip("rclpy")

from benchmarks import storms
from benchmarks.ros import stack
from benchmarks.storm_watch import Watch
from benchmarks.storms import STORMS, goals, run

pytestmark = [pytest.mark.ros, pytest.mark.slow]

SECONDS = 3.0


@pytest.fixture(scope="module")
def watch() -> Iterator[Watch]:
    with pytest.MonkeyPatch.context() as patch, stack():
        patch.setattr(storms, "CLIENTS", 8)
        watch = Watch()
        thread = threading.Thread(target=watch.run)
        thread.start()
        try:
            goals(0.0)  # to where every storm begins
            yield watch
        finally:
            watch.end()
            thread.join()


@pytest.mark.parametrize("name", [name for name in STORMS if name != "nothing"])
def test_after_the_storm_the_arm_stands_where_it_stood_and_the_cycles_have_gone_on(watch: Watch, name: str) -> None:
    stamps_s, _, away_rad = run(name, SECONDS, watch)
    assert away_rad < 1e-3
    assert len(stamps_s) > 20
    assert stamps_s == sorted(stamps_s)
