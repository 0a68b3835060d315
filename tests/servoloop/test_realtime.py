"""The control loop runs on one processor and with real-time priority, if the system allows it."""

import os
import threading
from collections.abc import Collection

import pytest

from servoloop.stack.processes import PRIORITY, on_one_processor, realtime_priority


def test_the_loop_stays_on_one_allowed_processor() -> None:
    before = os.sched_getaffinity(0)
    with on_one_processor():
        there = os.sched_getaffinity(0)
    assert len(there) == 1
    assert there <= before
    assert os.sched_getaffinity(0) == before


def test_an_exception_restores_the_allowed_processors() -> None:
    before = os.sched_getaffinity(0)
    with pytest.raises(ZeroDivisionError), on_one_processor():
        raise ZeroDivisionError
    assert os.sched_getaffinity(0) == before


def test_other_threads_are_not_affected() -> None:
    before = os.sched_getaffinity(0)
    pinned, seen = threading.Event(), list[set[int]]()

    def look() -> None:
        pinned.wait()
        seen.append(os.sched_getaffinity(0))

    other = threading.Thread(target=look)
    other.start()
    with on_one_processor():
        pinned.set()
        other.join()
    assert seen == [before]


def test_the_loop_also_runs_if_the_system_refuses(monkeypatch: pytest.MonkeyPatch) -> None:
    before, ran = os.sched_getaffinity(0), False

    def refuse(pid: int, mask: Collection[int]) -> None:
        raise PermissionError(pid, f"not {mask}")

    monkeypatch.setattr(os, "sched_setaffinity", refuse)
    with on_one_processor():
        ran = True
    assert ran
    assert os.sched_getaffinity(0) == before


def test_only_threads_that_start_in_the_context_have_real_time_priority(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[int, int]] = []
    monkeypatch.setattr(
        os, "sched_setscheduler", lambda pid, policy, param: asked.append((policy, param.sched_priority))
    )
    before = os.sched_getscheduler(0), os.sched_getparam(0).sched_priority
    with realtime_priority(PRIORITY):
        assert asked == [(os.SCHED_RR, PRIORITY)]
    assert asked[1:] == [before]
