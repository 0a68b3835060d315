"""Thousands of cycles on a bad line, and every single fault by itself: nothing wrong is ever believed."""

import math

import pytest

from drivers.bus import ServoFault, ServoGoal, ServoState
from drivers.dynamixel1 import tables as dxl
from drivers.feetech import scs
from drivers.read_each.patience import FIRST_REPLY_S
from drivers.turns import overlapped
from sim_backend.faults import Disturbance
from sim_backend.line import Reply
from sim_backend.port import VirtualPort
from tests.drivers.read_each_lines import IDS, KINDS, Kind, Line, Truth

every_kind = pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
two_kinds = pytest.mark.parametrize("kind", (KINDS[0], KINDS[3]), ids=lambda kind: kind.name)


class EchoingPort(VirtualPort):
    """An adapter that gives back what is sent through it."""

    _own = b""

    def write(self, data: bytes) -> None:
        super().write(data)
        self._own += data

    def read(self, size: int, deadline_s: float) -> bytes:
        own, self._own = self._own[:size], self._own[size:]
        return own + super().read(size - len(own), deadline_s)

    def discard_input(self) -> None:
        super().discard_input()
        self._own = b""


class SlowPort(VirtualPort):
    """An adapter that keeps what it hears for 16 ms."""

    def write(self, data: bytes) -> None:
        before = len(self._coming)
        super().write(data)
        for at in range(before, len(self._coming)):
            self._coming[at] = Reply(self._clock.now() + 0.016, self._coming[at].data)


@every_kind
def test_thousands_of_cycles_on_a_bad_line(kind: Kind) -> None:
    """Every value is the right one of this very cycle, and the counters say what was done to the line."""
    cycles = 2000
    line = Line(kind)
    truth = Truth(line)
    line.faults.disturbance = done = Disturbance(seed=3, drop=0.05, flip=0.02, noise=0.02)
    states = 0
    for number in range(cycles):
        truth.number = number
        for servo_id, reading in line.cycle().items():
            if isinstance(reading, ServoState):
                states += 1
                assert truth.holds(servo_id, reading), (number, servo_id)
    for servo_id in IDS:
        account = line.account(servo_id)
        dropped, flipped = done.done["drop", servo_id], done.done["flip", servo_id]
        assert account.silent + account.corrupt + account.late == dropped + flipped
        # In a bulk read, garbage may lie beside the wrong one of two that are missing.
        assert account.silent == pytest.approx(dropped, abs=5 if kind.name == "mx-28" else 0)
        assert account.retries > 0 and account.alarms == 0
    noise = sum(count for (what, _), count in done.done.items() if what == "noise")
    assert line.bus.counters.noise == pytest.approx(noise, rel=0.05)
    assert states > 0.99 * cycles * len(IDS)


@every_kind
def test_late_replies_among_everything_else(kind: Kind) -> None:
    """Every question ends in exactly one of four, also where replies come in the next question's time."""
    line = Line(kind)
    truth = Truth(line)
    line.faults.disturbance = done = Disturbance(seed=4, drop=0.03, flip=0.02, noise=0.02)
    for number in range(500):
        truth.number = number * 10
        if number % 3 == 0:
            line.faults.delay_next(IDS[number % len(IDS)])
        for servo_id, reading in line.cycle().items():
            assert not isinstance(reading, ServoState) or truth.holds(servo_id, reading), (number, servo_id)
        truth.number += 1  # whatever arrives from now on is old
    accounts = [line.account(i) for i in IDS]
    assert sum(a.late for a in accounts) > 80
    lost = sum(count for (what, _), count in done.done.items() if what in ("drop", "flip"))
    faults = sum(a.silent + a.corrupt + a.late for a in accounts)
    assert faults == pytest.approx(lost + 167, abs=12)  # a late reply can be dropped or flipped itself
    assert all(a.silent >= 0 for a in accounts)


@every_kind
def test_a_lost_reply_is_asked_for_again_in_the_same_cycle(kind: Kind) -> None:
    line = Line(kind)
    line.faults.corrupt_next(3)
    assert line.missing() == {}
    account = line.account(3)
    assert (account.corrupt, account.retries, account.replies) == (1, 1, 1)


@every_kind
def test_the_deadline_ends_the_wait_of_a_dead_line(kind: Kind) -> None:
    line = Line(kind)
    for servo_id in IDS:
        line.faults.silence(servo_id)
    begin_s = line.clock.now()
    readings = line.bus.read_states(IDS, begin_s + 0.004)
    assert line.clock.now() <= begin_s + 0.0041
    assert all(isinstance(reading, ServoFault) and reading.kind == "silent" for reading in readings.values())


def test_who_was_not_asked_is_first_the_next_time() -> None:
    line = Line(KINDS[0])
    readings = line.bus.read_states(IDS, line.clock.now() + 0.001)
    unasked = [i for i, r in readings.items() if isinstance(r, ServoFault)]
    assert 0 < len(unasked) < len(IDS)
    assert "was not asked: the cycle was over" in str(readings[unasked[0]])
    assert line.account(unasked[0]).skipped == 1 and line.account(unasked[0]).silent == 0
    again = line.bus.read_states(IDS, line.clock.now() + 0.001)
    assert all(isinstance(again[i], ServoState) for i in unasked)


@every_kind
@pytest.mark.parametrize("silent", (1, 4, 7))
def test_a_servo_known_to_be_silent_costs_little_and_hides_nobody(kind: Kind, silent: int) -> None:
    line = Line(kind)
    begin_s = line.clock.now()
    line.bus.read_states(IDS, begin_s + 0.05)
    whole_s = line.clock.now() - begin_s
    line.faults.silence(silent)
    costs = []
    for _ in range(300):
        begin_s = line.clock.now()
        readings = line.bus.read_states(IDS, begin_s + 0.05)
        costs.append(line.clock.now() - begin_s - whole_s)
        assert {i for i, r in readings.items() if isinstance(r, ServoFault)} == {silent}
        line.clock.sleep_until(begin_s + 0.05)
    assert sorted(costs)[296] < 0.003  # of 300; the first cycle asks again
    assert max(costs) < 0.012
    account = line.account(silent)
    assert account.silent + account.skipped == 300 + account.retries
    assert account.skipped > 200


@every_kind
@pytest.mark.parametrize("silent", ((1,), (7,), IDS))
def test_servos_that_are_back_are_read_within_a_second(kind: Kind, silent: tuple[int, ...]) -> None:
    line = Line(kind)
    for servo_id in silent:
        line.faults.silence(servo_id)
    for _ in range(200):
        assert set(line.missing()) == set(silent)
    for servo_id in silent:
        line.faults.restore(servo_id)
    for _ in range(50):
        line.cycle()
    assert line.missing() == {}


@every_kind
@pytest.mark.parametrize("servo_id", (1, 4, 7))
def test_a_late_reply_is_never_taken_for_the_present_one(kind: Kind, servo_id: int) -> None:
    line = Line(kind)
    truth = Truth(line)
    for number in range(60):
        truth.number = number
        if number % 5 == 0:
            line.faults.delay_next(servo_id)
        for i, reading in line.cycle().items():
            assert not isinstance(reading, ServoState) or truth.holds(i, reading)
        truth.number += 1  # whatever arrives from now on is old
    account = line.account(servo_id)
    assert account.late == 12
    assert account.silent == 0
    assert line.missing() == {}


@pytest.mark.parametrize("series", {kind.series.name: kind.series for kind in KINDS}.values(), ids=lambda s: s.name)
def test_lengths_that_tell_late_replies_survive_a_flipped_bit(series) -> None:  # type: ignore[no-untyped-def]
    lengths = [size + 2 for size in series.state_sizes]
    assert all((a ^ b).bit_count() >= 2 for a in lengths for b in lengths if a != b)
    tables = [scs.REGISTERS] if series.byte_order == "big" else [dxl.registers(m) for m in series.models]
    # Two bytes beyond the memory table stand in Feetech's header of the SCS series.
    ends = [max(r.address + r.size for r in table) for table in tables]
    assert series.state_address + max(series.state_sizes) <= min(ends)


@every_kind
def test_an_adapter_that_echoes_is_understood(kind: Kind) -> None:
    line = Line(kind, EchoingPort)
    line.bus.torque_on(2)
    half = line.bus.goal(2) or 512
    for _ in range(20):
        line.bus.write_goals({i: ServoGoal(half) for i in IDS})
        assert line.missing() == {}
    line.faults.silence(4)
    assert line.missing() == {4: "silent"}
    assert line.bus.goal(2) == half
    assert set(line.bus.exchange({1: ServoGoal(half + 9)}, IDS, line.clock.now() + 0.01)) == set(IDS)
    assert line.bus.goal(1) == half + 9
    assert line.bus.counters.noise == line.bus.counters.strange == 0


@two_kinds
def test_a_slow_adapter_is_waited_for(kind: Kind) -> None:
    """16 ms a reply, from the first on, also when one of the servos is dead."""
    line = Line(kind, SlowPort)
    line.faults.silence(1)
    seen: set[int] = set()
    for _ in range(20):
        readings = line.bus.read_states(IDS, line.clock.now() + 0.5)
        seen |= {i for i, r in readings.items() if isinstance(r, ServoState)}
        line.clock.sleep_until(line.clock.now() + 0.1)
    assert seen == set(IDS) - {1}
    assert {i for i, r in readings.items() if isinstance(r, ServoFault)} == {1}


@two_kinds
def test_alarms_are_named_and_counted(kind: Kind) -> None:
    line = Line(kind)
    register = dxl.max_voltage_limit if kind.order == "little" else scs.max_voltage
    line.bus.write(3, register, 50)
    line.clock.sleep_until(line.clock.now() + 0.1)
    reading = line.bus.read_states(IDS)[3]
    assert isinstance(reading, ServoState)
    assert reading.alarms == ("voltage",)
    assert line.account(3).alarms == 1


def test_transactions_on_several_lines_overlap() -> None:
    """Two lines on one clock take hardly longer than one: the bytes of the second gather meanwhile."""
    lines = [Line(KINDS[0]), Line(KINDS[0])]
    clock = lines[0].clock
    lines[1].bus._clock = lines[1].bus._line._clock = lines[1].port._clock = clock
    begin_s = clock.now()
    lines[0].bus.read_states(IDS, math.inf)
    alone_s = clock.now() - begin_s
    begin_s = clock.now()
    both = overlapped([line.bus.state_steps(IDS, math.inf) for line in lines])
    assert clock.now() - begin_s < alone_s * 1.1
    assert all(isinstance(reading, ServoState) for readings in both for reading in readings.values())
    assert alone_s < FIRST_REPLY_S
