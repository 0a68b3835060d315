"""Behavior of every bus with late replies, unusual adapters and several buses at once."""

import math

import pytest

from drivers.bus.adaptive_timeout import FIRST_REPLY_S
from drivers.types import ServoFault, ServoGoal, ServoState
from sim_backend.clock import SimulatedClock
from sim_backend.faults import Disturbance
from tests.drivers.cycles import exchange
from tests.drivers.fault_lines import IDS, KINDS, Kind, Line, Truth, every_kind, every_servo
from tests.drivers.ports import EchoingPort, SlowPort

PLAIN = [kind for kind in KINDS if not kind.with_goals and not kind.mapped]


@every_kind
def test_late_replies_among_other_faults(kind: Kind) -> None:
    """Every request is counted exactly once, even if replies arrive during the next request."""
    line = Line(kind)
    truth = Truth(line)
    line.faults.disturbance = done = Disturbance(seed=4, drop=0.03, flip=0.02, noise=0.02)
    for number in range(500):
        truth.number = number * 10
        if number % 3 == 0:
            line.faults.delay_next(IDS[number % len(IDS)])
        for servo_id, reading in line.cycle().items():
            assert not isinstance(reading, ServoState) or truth.holds(servo_id, reading), (number, servo_id)
        truth.number += 1  # replies to earlier requests are outdated from now on
    accounts = [line.account(i) for i in IDS]
    assert sum(a.late for a in accounts) > 80
    lost = sum(count for (what, _), count in done.done.items() if what in ("drop", "flip"))
    faults = sum(a.silent + a.corrupt + a.late for a in accounts)
    assert faults == pytest.approx(lost + 0.95 * 167, abs=10)  # a late reply may also be dropped or flipped
    assert all(a.silent >= 0 for a in accounts)


@every_servo
def test_a_late_reply_is_never_taken_for_the_current_reply(kind: Kind, servo_id: int) -> None:
    line = Line(kind)
    truth = Truth(line)
    for number in range(60):
        truth.number = number
        if number % 5 == 0:
            line.faults.delay_next(servo_id)
        for i, reading in line.cycle().items():
            assert not isinstance(reading, ServoState) or truth.holds(i, reading)
        truth.number += 1  # replies to earlier requests are outdated from now on
    account = line.account(servo_id)
    assert (account.silent, account.late) == (0, 12)
    assert line.missing() == {}


@every_kind
def test_two_late_replies_that_arrive_together_are_both_counted(kind: Kind) -> None:
    line = Line(kind)
    take_held, line.faults.take_held = line.faults.take_held, bytes  # type: ignore[method-assign]
    for _ in range(2):
        line.faults.delay_next(3)
        assert isinstance(line.bus.read_states((3,), line.clock.now() + 0.004)[3], ServoFault)
    account = line.account(3)
    assert (account.silent, account.late) == (2, 0)
    line.faults.take_held = take_held  # type: ignore[method-assign]
    assert line.missing() == {}
    assert (account.silent, account.late) == (0, 2)


@every_kind
def test_replies_of_a_slow_adapter_are_received(kind: Kind) -> None:
    """Every reply, including the first, is delayed by 16 ms, even if one servo is silent."""
    line = Line(kind, SlowPort)
    line.faults.silence(1)
    seen: set[int] = set()
    for _ in range(20):
        readings = line.states(line.clock.now() + 0.5)
        seen |= {i for i, r in readings.items() if isinstance(r, ServoState)}
        line.clock.sleep_until(line.clock.now() + 0.1)
    assert seen == set(IDS) - {1}
    assert {i for i, r in readings.items() if isinstance(r, ServoFault)} == {1}


@every_kind
def test_echoes_are_removed(kind: Kind) -> None:
    line = Line(kind, EchoingPort)
    middle = kind.table.middle
    assert line.bus.read(2, kind.table.position) == line.held(2, kind.table.position) > 0
    line.bus.torque_on(2)
    for _ in range(20):
        line.bus.write_goals({i: ServoGoal(middle) for i in IDS})
        assert line.missing() == {}
    line.faults.silence(4)
    assert line.missing() == {4: "silent"}
    assert line.bus.goal(2) == middle
    assert set(exchange(line.bus, {1: ServoGoal(middle + 9)}, IDS, line.clock.now() + 0.01)) == set(IDS)
    assert line.bus.goal(1) == middle + 9
    assert line.bus.counters.noise == line.bus.counters.strange == 0


@every_kind
def test_an_echo_longer_than_the_reply_is_detected(kind: Kind) -> None:
    line = Line(kind, EchoingPort)
    for _ in range(5):
        goals = {1: ServoGoal(kind.table.middle)}
        readings = exchange(line.bus, goals, (1,), line.clock.now() + kind.table.budget_s)
        assert isinstance(readings[1], ServoState)
        line.clock.sleep_until(line.clock.now() + kind.table.period_s)
    assert line.bus.counters.noise == line.bus.counters.strange == 0


@pytest.mark.parametrize("kind", [kind for kind in KINDS if not kind.one_by_one], ids=lambda kind: kind.name)
def test_reads_of_several_buses_overlap(kind: Kind) -> None:
    """Two buses take hardly longer than one bus, because the second bus receives its bytes while the first bus is
    read."""
    clock = SimulatedClock(50.0)
    lines = [Line(kind, clock=clock), Line(kind, clock=clock)]
    begin_s = clock.now()
    lines[0].bus.read_states(IDS, math.inf)
    alone_s = clock.now() - begin_s
    begin_s = clock.now()
    for line in lines:
        line.bus.request(IDS, math.inf)
    both = [line.bus.receive() for line in lines]
    assert clock.now() - begin_s < alone_s * 1.1
    assert all(isinstance(reading, ServoState) for readings in both for reading in readings.values())
    assert alone_s < FIRST_REPLY_S


@pytest.mark.parametrize(("period_s", "dead_first"), [(0.02, True), (0.05, False)], ids=["dead first", "dead last"])
@pytest.mark.parametrize(
    ("alive", "dead"),
    [
        # Every run tests each kind together with one other kind, and the long run tests all pairs.
        pytest.param(
            alive,
            dead,
            id=f"{alive.name}, {dead.name} dead",
            marks=() if dead is PLAIN[place - 1] else pytest.mark.slow,
        )
        for place, alive in enumerate(PLAIN)
        for dead in PLAIN
    ],
)
def test_a_silent_bus_does_not_affect_another_bus(alive: Kind, dead: Kind, period_s: float, dead_first: bool) -> None:
    clock = SimulatedClock(50.0)
    lines = {"dead": Line(dead, clock=clock), "alive": Line(alive, clock=clock)}
    order = sorted(lines, reverse=dead_first)
    for number in range(60):
        if number == 3:
            for servo_id in IDS:
                lines["dead"].faults.silence(servo_id)
        begin_s = clock.now()
        deadline_s = begin_s + period_s / 2.0
        for which in order:
            lines[which].bus.request(IDS, deadline_s)
        # The order is that of hal/servos/joint_buses.py: first the buses whose servos are read one by one, silent buses
        # last.
        in_turn = sorted(order, key=lambda which: (which == "dead", lines[which].bus.read_together))
        of = {which: lines[which].bus.receive() for which in in_turn}
        assert all(isinstance(reading, ServoState) for reading in of["alive"].values()), number
        assert clock.now() <= deadline_s
        clock.sleep_until(begin_s + period_s)


@every_kind
def test_time_spent_on_another_bus_is_not_counted(kind: Kind) -> None:
    """A silent servo costs no more time if another bus is read first."""

    def cost_s(other_line_s: float) -> float:
        line = Line(kind)
        for _ in range(10):
            line.bus.request(IDS, line.clock.now() + 0.5)
            line.clock.sleep_until(line.clock.now() + other_line_s)
            assert all(isinstance(reading, ServoState) for reading in line.bus.receive().values())
        line.faults.silence(4)
        begin_s = line.clock.now()
        line.bus.read_states(IDS, begin_s + 0.5)
        return line.clock.now() - begin_s

    assert cost_s(0.015) <= cost_s(0.0) + 0.0005
