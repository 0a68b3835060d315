"""Effect of a silent servo on the other servos of its bus, as ``benchmarks.bus`` measures it."""

import io

import pytest
from rich.console import Console

from benchmarks.dynamixel_servos import DynamixelServos
from benchmarks.silent_servo import MODELS, PERIODS_S, lost_cycles, show_silent
from drivers.protocol import v2 as wire


@pytest.mark.parametrize("period_s", PERIODS_S)
@pytest.mark.parametrize("make", MODELS)
def test_a_silent_servo_costs_the_others_at_most_one_cycle(make: str, period_s: float) -> None:
    lost = lost_cycles(make, 7, period_s)
    assert max(lost.values()) <= 1
    assert all(count == 0 for silent, count in lost.items() if silent > 1)


def test_the_table_has_a_line_for_each_make_and_period() -> None:
    text = io.StringIO()
    show_silent(Console(file=text, width=100), 3)
    assert text.getvalue().count(" ms ") == len(MODELS) * len(PERIODS_S)


@pytest.mark.parametrize("code", [wire.SYNC_READ, wire.FAST_SYNC_READ])
@pytest.mark.parametrize(("silent", "heard"), [(1, 0), (2, 1), (3, 2)])
def test_the_servos_of_the_benchmark_wait_for_each_other_like_real_servos(code: int, silent: int, heard: int) -> None:
    servos = DynamixelServos([1, 2, 3])
    servos.silence({silent})
    reply = servos.answer(wire.packet(wire.BROADCAST_ID, code, wire.span(132, 4) + bytes((1, 2, 3))))
    size, head = (15, 0) if code == wire.SYNC_READ else (8, 8 if heard else 0)
    assert len(reply) == head + size * heard
