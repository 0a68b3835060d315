"""Faults specific to buses that ask servos one by one: servos for which no time is left, and late replies recognized by
their length."""

import pytest

from drivers.servos import ax_mx as dxl
from drivers.servos import scs
from drivers.servos.dynamixel1 import AX_MX
from drivers.servos.feetech import SCS
from drivers.servos.series import Series
from drivers.types import ServoFault, ServoState
from tests.drivers.fault_lines import IDS, READ_EACH, Line


def test_a_servo_that_was_not_asked_is_first_in_the_next_cycle() -> None:
    line = Line(READ_EACH[0])
    readings = line.bus.read_states(IDS, line.clock.now() + 0.001)
    unasked = [i for i, r in readings.items() if isinstance(r, ServoFault)]
    assert 0 < len(unasked) < len(IDS)
    assert "was not measured: the cycle had no time left" in str(readings[unasked[0]])
    assert line.account(unasked[0]).no_time == 1 and line.account(unasked[0]).silent == 0
    again = line.bus.read_states(IDS, line.clock.now() + 0.001)
    assert all(isinstance(again[i], ServoState) for i in unasked)


@pytest.mark.parametrize("series", (SCS, AX_MX), ids=lambda series: series.name)
def test_reply_lengths_differ_in_more_than_one_bit(series: Series) -> None:
    sizes = [block.size for block in series.blocks]
    lengths = [size + 2 for size in sizes]
    assert all((a ^ b).bit_count() >= 2 for a in lengths for b in lengths if a != b)
    tables = [scs.REGISTERS] if series is SCS else [dxl.registers(m) for m in series.models]
    # Feetech's header file of the SCS series has two bytes more than the memory table.
    ends = [max(r.address + r.size for r in table) for table in tables]
    assert series.blocks[0].address + max(sizes) <= min(ends)
