"""Tests of the thread that publishes cycles."""

import threading
from collections.abc import Sequence
from typing import Any

import numpy as np

from hal.types import JointState
from nodes.cycle_publisher import KEPT_CYCLES, CyclePublisher

PATIENCE_S = 30.0


def state(stamp_s: float) -> JointState:
    unknown = np.empty(0)
    return JointState(stamp_s, unknown, unknown, unknown)


def test_cycles_are_published_in_their_order_by_another_thread() -> None:
    published: list[Any] = []
    publisher = CyclePublisher(lambda states: published.extend((one.stamp_s, threading.get_ident()) for one in states))
    publisher.start()
    for number in range(50):
        publisher.post(state(number))
        assert number % 7 or publisher.wait_until_published(PATIENCE_S)
    publisher.stop()
    assert [stamp_s for stamp_s, _ in published] == list(range(50))
    assert threading.get_ident() not in {thread for _, thread in published}


def test_a_slow_publication_does_not_block_the_loop_and_drops_the_oldest_cycles() -> None:
    begun, goes_on = threading.Event(), threading.Event()
    published: list[float] = []

    def publish(states: Sequence[JointState]) -> None:
        begun.set()
        goes_on.wait(PATIENCE_S)
        published.extend(one.stamp_s for one in states)

    publisher = CyclePublisher(publish)
    publisher.start()
    publisher.post(state(-1.0))
    assert begun.wait(PATIENCE_S)
    for number in range(KEPT_CYCLES + 10):
        publisher.post(state(number))
    assert not publisher.wait_until_published(0.01)
    goes_on.set()
    assert publisher.wait_until_published(PATIENCE_S)
    publisher.stop()
    assert published == [-1.0, *range(10, KEPT_CYCLES + 10)]


def test_the_last_cycles_are_published_before_the_end() -> None:
    published: list[float] = []
    publisher = CyclePublisher(lambda states: published.extend(one.stamp_s for one in states))
    publisher.start()
    publisher.post(state(1.0))
    publisher.stop()
    assert published == [1.0]
