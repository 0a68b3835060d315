"""A silent Dynamixel silences the servos that are listed after it. The bus reads these servos again in the same
cycle."""

from collections.abc import Mapping

import pytest

from drivers.servos import x
from drivers.servos.register import ServoModel
from drivers.types import ServoFault
from tests.drivers.dynamixel_lines import TrueLine

ALIKE: Mapping[int, ServoModel] = {i: (x.XM430_W350, x.XL430_W250)[i % 2] for i in range(1, 8)}
MIXED: Mapping[int, ServoModel] = {i: (x.XL430_W250, x.XL330_M288)[i % 2] for i in range(1, 8)}
LINES = {
    "fast sync read": (ALIKE, {}),
    "sync read, old firmware": (ALIKE, dict.fromkeys(ALIKE, 44)),
    "bulk read": (MIXED, {i: 44 for i, model in MIXED.items() if model is x.XL330_M288}),
}
"""Models and firmware versions of a line, by the kind of group read that the line supports."""
each_read = pytest.mark.parametrize(("models", "firmware"), LINES.values(), ids=LINES)


def lost(line: TrueLine, silent: set[int], cycles: int) -> dict[int, int]:
    """Run cycles and return how many cycles each servo missed, except for the silent servos."""
    faults = [set(line.faults()) - silent for _ in range(cycles)]
    return {i: sum(i in missed for missed in faults) for i in line.ids if any(i in missed for missed in faults)}


@each_read
@pytest.mark.parametrize("silent", range(1, 8))
def test_one_silent_servo_costs_the_others_no_cycle(
    models: Mapping[int, ServoModel], firmware: Mapping[int, int], silent: int
) -> None:
    line = TrueLine(models, firmware).identified()
    assert lost(line, set(), 3) == {}
    line.servos.faults.silence(silent)
    assert lost(line, {silent}, 60) == {}
    line.servos.faults.restore(silent)
    assert lost(line, {silent}, 60) == {}
    assert line.faults() == {}


@each_read
@pytest.mark.parametrize("silent", [{1, 2}, {1, 7}, {2, 4, 6}, {1, 2, 3, 4, 5, 6}], ids=str)
def test_several_silent_servos_cost_the_others_at_most_one_cycle(
    models: Mapping[int, ServoModel], firmware: Mapping[int, int], silent: set[int]
) -> None:
    line = TrueLine(models, firmware).identified()
    assert lost(line, set(), 3) == {}
    for servo_id in silent:
        line.servos.faults.silence(servo_id)
    assert max(lost(line, silent, 60).values(), default=0) <= 1
    back = min(silent)
    line.servos.faults.restore(back)
    line.clock.sleep_until(line.clock.now() + 1.0)
    for _ in range(60):
        line.cycle()
    assert set(line.faults()) == silent - {back}


@each_read
def test_a_silent_servo_does_not_hide_torque_states(
    models: Mapping[int, ServoModel], firmware: Mapping[int, int]
) -> None:
    line = TrueLine(models, firmware).identified()
    line.servos.faults.silence(2)
    line.cycle()
    line.clock.sleep_until(line.clock.now() + 1.0)  # a late reply is no longer possible
    others = tuple(i for i in line.ids if i != 2)
    states = line.bus.torque_states(line.ids, line.clock.now() + 0.02)
    assert states == dict.fromkeys(others, False)


@each_read
def test_servos_are_read_within_a_budget_that_leaves_no_time_for_a_repetition(
    models: Mapping[int, ServoModel], firmware: Mapping[int, int]
) -> None:
    line = TrueLine(models, firmware).identified()
    assert lost(line, set(), 3) == {}
    line.servos.faults.silence(1)
    missed = []
    for _ in range(60):
        readings = line.bus.read_states(line.ids, line.clock.now() + 0.005)
        missed.append({i for i, reading in readings.items() if isinstance(reading, ServoFault)} - {1})
        line.clock.sleep_until(line.clock.now() + 0.002)
    assert sum(map(bool, missed)) <= 1
