"""A bus flooded with endless noise: no cycle exceeds its time, and the first cycle afterwards reads every state."""

import random

import pytest

from drivers.types import ServoState
from sim_backend.buses.port import VirtualPort
from tests.drivers.fault_lines import IDS, KINDS, READ_EACH, Kind, Line

FLOOD_S = 1.0
BYTE_S = 1e-6
"""Rate of a faulty adapter or a pseudo-terminal, ten times that of a serial line at 1 Mbit/s."""
COPIED_S = 2e-9
"""Time that the kernel needs to return a received byte."""
LEFT_BYTES = 300_000
"""Bytes in the buffers of the kernel and the adapter when the flood ends. A flush discards only some of these bytes."""
FLUSHED_BYTES = 70_000


class FloodedPort(VirtualPort):
    """A port on which reads immediately return as many noise bytes as requested."""

    noise = b""
    flooded_until_s = -1.0
    left = 0

    def read(self, size: int, deadline_s: float) -> bytes:
        flooded = self._clock.now() < self.flooded_until_s
        count = size if flooded else min(size, self.left)
        if not count:
            return super().read(size, deadline_s)
        if flooded:
            super().discard_input()  # the reply is lost in the noise
            self._clock.sleep_until(self._clock.now() + count * BYTE_S)
        else:
            self.left -= count
            self._clock.sleep_until(self._clock.now() + count * COPIED_S)
        return (self.noise * (1 + count // len(self.noise)))[:count]

    def discard_input(self) -> None:
        super().discard_input()
        self.left = max(0, self.left - FLUSHED_BYTES)


@pytest.mark.parametrize("kind", [KINDS[0], KINDS[1], *READ_EACH[::2]], ids=lambda kind: kind.name)
@pytest.mark.parametrize(
    "noise",
    [random.Random(1).randbytes(4099), b"\xff", b"\xff\xff\x01\x40", b"\xff\xff\xfd\x00\x01\x40\x00\x55", b"\x00"],
    ids=["random", "ff", "header", "header 2", "zero"],
)
def test_the_first_cycle_after_a_flood_has_every_state(kind: Kind, noise: bytes) -> None:
    line = Line(kind, FloodedPort)
    port, period_s = line.port, kind.table.period_s
    assert isinstance(port, FloodedPort)
    for _ in range(3):
        assert line.missing() == {}
    port.noise, port.flooded_until_s = noise, line.clock.now() + FLOOD_S
    longest_s = 0.0
    while (begin_s := line.clock.now()) < port.flooded_until_s:
        line.states(begin_s + kind.table.budget_s)
        longest_s = max(longest_s, line.clock.now() - begin_s)
        line.clock.sleep_until(begin_s + period_s)
    port.left = LEFT_BYTES
    assert longest_s <= period_s
    begin_s = line.clock.now()
    first = line.states(begin_s + kind.table.budget_s)
    assert line.clock.now() - begin_s <= period_s
    assert {i for i in IDS if isinstance(first[i], ServoState)} == set(IDS)
