"""The rate limiter of publishers, which is evaluated once per cycle."""

from collections.abc import Sequence

import pytest

pytest.importorskip("rclpy")

from nodes.publishing import RateLimiter


def times(stamps_s: Sequence[float], rate_hz: float) -> list[float]:
    """Return the times at which a message was due."""
    pace = RateLimiter()
    return [stamp_s for stamp_s in stamps_s if pace.due(stamp_s, rate_hz)]


@pytest.mark.parametrize(
    ("cycle_hz", "rate_hz", "expected"),
    [(20, 20, 200), (20, 1000, 200), (100, 20, 200), (20, 5, 50), (30, 20, 200), (20, 0.5, 5)],
)
def test_rate_is_reached_over_ten_seconds(cycle_hz: int, rate_hz: float, expected: int) -> None:
    done = times([number / cycle_hz for number in range(10 * cycle_hz)], rate_hz)
    assert len(done) == pytest.approx(expected, abs=2)


def test_slightly_early_or_late_cycles_are_not_skipped() -> None:
    stamps_s = [0.05 * number + (0.004 if number % 2 else -0.004) for number in range(100)]
    assert times(stamps_s, 20.0) == stamps_s


def test_no_burst_follows_a_long_pause() -> None:
    pauses = [0.0, 5.0, *(5.0 + 0.01 * number for number in range(1, 21))]
    assert times(pauses, 20.0) == pytest.approx([0.0, 5.0, 5.03, 5.08, 5.13, 5.18], abs=0.011)


def test_limiter_continues_after_time_jumps_back() -> None:
    assert times([100.0, 0.0, 0.05, 0.1], 20.0) == [100.0, 0.0, 0.05, 0.1]
