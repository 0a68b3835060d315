"""A bus tap records all bytes that were read and written, and reports each write to an observer."""

import pytest

from drivers.driver_errors import PortLost
from servoloop.recording.bus_tap import BusTap
from sim_backend.clock import SimulatedClock

READ, WRITTEN = b"\xff\xff\x01", b"\xff\xff\x02"


class Wire:
    """Port whose cable can be pulled. Each call of the port takes a millisecond."""

    name, baud = "/dev/ttyACM0", 1_000_000

    def __init__(self, clock: SimulatedClock) -> None:
        self.clock, self.lost = clock, False

    def write(self, data: bytes) -> None:
        self.clock.sleep_until(self.clock.now() + 0.001)
        if self.lost:
            raise PortLost("the adapter has been unplugged")

    def read(self, size: int, deadline_s: float) -> bytes:
        self.clock.sleep_until(self.clock.now() + 0.001)
        return READ[:size]

    def discard_input(self) -> None: ...
    def set_baud(self, baud: int) -> None: ...
    def close(self) -> None: ...


@pytest.fixture
def tap() -> BusTap[Wire]:
    clock = SimulatedClock(1.0)
    return BusTap(Wire(clock), clock)


def test_a_write_has_the_time_of_its_start_and_a_read_that_of_its_end(tap: BusTap[Wire]) -> None:
    tap.write(WRITTEN)
    assert tap.read(3, 2.0) == READ
    assert tap.sent == [(pytest.approx(1.0), WRITTEN)] and tap.received == [(pytest.approx(1.002), READ)]


def test_a_write_that_fails_is_reported_but_not_recorded(tap: BusTap[Wire]) -> None:
    seen: list[bytes] = []
    tap.on_write, tap.port.lost = seen.append, True
    with pytest.raises(PortLost):
        tap.write(WRITTEN)
    assert seen == [WRITTEN] and tap.sent == []
