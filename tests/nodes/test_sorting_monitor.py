"""Tests which apple started which job, according to the messages of the cell."""

import json
from types import SimpleNamespace

import pytest

from nodes.clients.sorting_monitor import SortingMonitor


def apples(stamp_s: float, *grades: str) -> SimpleNamespace:
    stamp = SimpleNamespace(sec=int(stamp_s), nanosec=round((stamp_s % 1.0) * 1e9))
    seen = [SimpleNamespace(grade=grade, diameter_mm=50.0, red_ratio=0.5, defect_score=0.0) for grade in grades]
    return SimpleNamespace(header=SimpleNamespace(stamp=stamp), apples=seen)


def state(request_id: int, time_s: float, phase: str, grade: str = "A") -> SimpleNamespace:
    content = {"request_id": request_id, "ts": time_s, "phase": phase, "grade": grade, "message": phase}
    return SimpleNamespace(data=json.dumps(content))


@pytest.fixture
def monitor() -> SortingMonitor:
    return SortingMonitor()


def test_the_first_apple_after_the_previous_job_starts_the_next_one(monitor: SortingMonitor) -> None:
    for stamp_s in (10.0, 10.1, 10.2):
        monitor._on_apples(apples(stamp_s, "A"))
    monitor._on_state(state(1, 10.15, "start"))
    monitor._on_apples(apples(12.0, "A"))
    monitor._on_state(state(1, 20.0, "done"))
    monitor._on_apples(apples(22.0))
    monitor._on_apples(apples(22.1, "", "b "))
    monitor._on_state(state(2, 22.2, "start", "B"))
    first, second = monitor.jobs
    assert first.picture_to_goal_s == pytest.approx(0.15) and first.success and first.ended
    assert second.picture_to_goal_s == pytest.approx(0.1) and not second.ended
    assert second.apple is not None and second.apple.grade == "B"


def test_an_apple_that_arrives_after_the_start_is_found(monitor: SortingMonitor) -> None:
    monitor._on_state(state(1, 10.1, "start"))
    assert monitor.jobs[0].picture_to_goal_s is None
    monitor._on_apples(apples(10.0, "A"))
    assert monitor.jobs[0].picture_to_goal_s == pytest.approx(0.1)
    monitor._on_apples(apples(10.2, "A"))
    assert monitor.jobs[0].picture_to_goal_s == pytest.approx(0.1)


def test_a_monitor_that_missed_the_picture_knows_the_values_of_the_next_one(monitor: SortingMonitor) -> None:
    monitor._on_state(state(1, 10.1, "start"))
    monitor._on_apples(apples(10.2, "A"))
    assert monitor.jobs[0].apple is not None and monitor.jobs[0].apple.stamp_s == pytest.approx(10.2)
    assert monitor.jobs[0].picture_to_goal_s is None


def test_other_grades_and_much_later_pictures_are_not_the_cause(monitor: SortingMonitor) -> None:
    monitor._on_apples(apples(10.0, "C"))
    monitor._on_state(state(1, 10.1, "start"))
    monitor._on_apples(apples(10.7, "A"))
    assert monitor.jobs[0].apple is None
    monitor._on_state(state(1, 11.0, "error"))
    assert monitor.jobs[0].ended and not monitor.jobs[0].success


def test_the_newest_message_may_have_no_apple(monitor: SortingMonitor) -> None:
    monitor._on_apples(apples(1.0, "A"))
    assert monitor.newest is not None
    monitor._on_apples(apples(1.1, ""))
    assert monitor.newest is None
