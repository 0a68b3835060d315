"""Every client receives its share of the rate, regardless of the requests of other clients."""

import pytest

from nodes.rclpy_patches.fair_rate import FairRate

RATE, BURST = 100.0, 20


def served(asked_hz: dict[str, float], seconds: float = 10.0) -> dict[str, int]:
    """Return the number of served requests of each client for given request rates."""
    rate = FairRate(RATE, BURST)
    asks = sorted((k / hz, name) for name, hz in asked_hz.items() for k in range(round(seconds * hz)))
    counts = dict.fromkeys(asked_hz, 0)
    for now_s, name in asks:
        counts[name] += rate.allows(name, now_s)
    return counts


@pytest.mark.parametrize("hz", [0.5, 10.0, 99.0])
def test_client_within_the_rate_is_always_served(hz: float) -> None:
    assert served({"one": hz}) == {"one": round(10 * hz)}


def test_excess_requests_of_one_client_are_refused() -> None:
    assert served({"one": 500.0})["one"] == pytest.approx(10 * RATE + BURST, abs=2)


@pytest.mark.parametrize("floods", [1, 5])
def test_slow_client_is_always_served_during_floods(floods: int) -> None:
    counts = served({f"flood{k}": 500.0 for k in range(floods)} | {"honest": 5.0})
    assert counts.pop("honest") == 50
    assert sum(counts.values()) <= 10 * RATE + floods * BURST
    assert max(counts.values()) - min(counts.values()) <= BURST


def test_idle_client_may_send_a_burst_again() -> None:
    rate = FairRate(RATE, BURST)
    assert [rate.allows("one", 0.0) for _ in range(BURST + 1)] == [True] * BURST + [False]
    assert [rate.allows("one", 5.0) for _ in range(BURST + 1)] == [True] * BURST + [False]


def test_inactive_clients_are_removed() -> None:
    rate = FairRate(RATE, BURST)
    for k in range(10_000):
        rate.allows(k, k * 0.01)
    assert len(rate._clients) < 200
