"""A silent servo does not affect the other servos of a bus at 20 Hz, and costs them at most one cycle at the highest
rate."""

import pytest

from drivers.types import ServoFault
from tests.drivers.fault_lines import IDS, KINDS, Kind, Line

SLOW_S = 0.04
"""Time for reading at 20 Hz, in seconds."""
SPARE_S = 0.002
"""Time that a cycle needs in addition to the time of its bytes, in seconds (see docs/bus.md)."""
CYCLES = 25
LINES = [kind for kind in KINDS if kind.mapped or not (kind.with_goals or kind.name.startswith("scs15"))]


def lost_cycles(line: Line, silent: set[int], budget_s: float) -> list[int]:
    """Silence servos, and return the numbers of the cycles in which another servo was not measured."""
    for servo_id in silent:
        line.faults.silence(servo_id)
    lost = []
    for number in range(CYCLES):
        begin_s = line.clock.now()
        readings = line.states(begin_s + budget_s)
        faults = {i for i, reading in readings.items() if isinstance(reading, ServoFault)}
        assert silent <= faults
        lost += [number] if faults - silent else []
        line.clock.sleep_until(begin_s + 1.1 * budget_s)
    return lost


def ready(kind: Kind) -> Line:
    """Return a line whose servos have all answered, as they do at set-up."""
    line = Line(kind)
    line.bus.read_states(IDS)
    assert line.missing() == {}
    return line


@pytest.mark.parametrize("silent", [{1}, {4}, {7}, {1, 2}, {1, 7}, {2, 5}, {6, 7}], ids=str)
@pytest.mark.parametrize("kind", LINES, ids=lambda kind: kind.name)
def test_the_others_are_read_in_every_cycle_after_the_first(kind: Kind, silent: set[int]) -> None:
    assert lost_cycles(ready(kind), silent, SLOW_S) == []
    assert lost_cycles(ready(kind), silent, kind.table.budget_s) == [] or len(silent) > 1
    line = ready(kind)
    budget_s = line.bus.exchange_size(line.goals, IDS) * 10.0 / line.port.baud + SPARE_S
    # Without time for a repetition, each servo that becomes silent costs the servos after it one cycle.
    assert lost_cycles(line, silent, budget_s) in ([], *(list(range(n)) for n in range(1, len(silent) + 1)))


@pytest.mark.parametrize("kind", [kind for kind in LINES if kind.waits and not kind.mapped], ids=lambda kind: kind.name)
def test_a_silent_servo_is_found_if_the_deadline_is_right_after_the_last_reply(kind: Kind) -> None:
    """The reply of the silent servo is due before the deadline, so the deadline cannot be the cause. The next cycle
    reads the servos after the silent one."""
    line = Line(kind)
    assert line.missing() == {}
    budget_s = line.bus.exchange_size({}, IDS) * 10.0 / line.port.baud + 0.0003
    assert lost_cycles(line, {4}, budget_s) == [0]
    assert {i: line.account(i).silent > 0 for i in IDS} == {i: i == 4 for i in IDS}
