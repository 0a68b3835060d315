"""Cycles of a Dynamixel bus without faults send the same bytes, and a missing reply switches to separate decoding."""

from collections.abc import Callable
from typing import Any

import pytest

from drivers.bus.bus import Bus
from drivers.bus.fast_read import FastReads
from drivers.bus.group_read import GroupRead
from drivers.bus.late_replies import OPEN_S
from drivers.bus.read_plan import ReadPlan
from drivers.protocol import v2 as wire
from drivers.servos import x
from drivers.types import ServoFault, ServoGoal, ServoState
from sim_backend.packets.dynamixel import Code
from tests.drivers.cycles import exchange
from tests.drivers.fault_lines import IDS, KINDS, Kind, Line, Truth
from tests.drivers.ports import WatchedPort

MAPPED = [kind for kind in KINDS if kind.with_goals and kind.mapped]
DIRECT = [kind for kind in KINDS if kind.with_goals and not kind.mapped and kind.model in x.MODELS.values()]
each_kind = pytest.mark.parametrize("kind", MAPPED + DIRECT, ids=lambda kind: kind.name)


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Return, for each request, whether its replies were decoded together."""
    went: list[bool] = []
    real = GroupRead.collect

    def collect(self: GroupRead, plan: ReadPlan, *how: Any) -> object:
        went.append(True)
        return real(self, plan, *how)

    def otherwise(owner: type[GroupRead] | type[FastReads], name: str) -> None:
        careful = getattr(owner, name)

        def judge(self: Any, *what: Any) -> object:
            went[-1] = False
            return careful(self, *what)

        monkeypatch.setattr(owner, name, judge)

    monkeypatch.setattr(GroupRead, "collect", collect)
    otherwise(GroupRead, "_decode_separately")
    otherwise(FastReads, "failed")
    return went


def steady_line(kind: Kind, *, fast: bool = True) -> tuple[Line, WatchedPort]:
    line = Line(kind, WatchedPort)
    assert isinstance(line.port, WatchedPort)
    if fast:
        line.bus.read_states(IDS)  # detects support for fast reads
    for _ in range(2):
        assert line.missing() == {}
    line.port.sent = ()
    return line, line.port


@each_kind
def test_every_cycle_sends_the_same_bytes(kind: Kind, quick: list[bool]) -> None:
    line, port = steady_line(kind)
    truth, replies = Truth(line), line.account(1).replies
    quick.clear()
    for _ in range(5):
        truth.number += 1
        readings = line.cycle()
        assert list(readings) == list(IDS)
        assert all(isinstance(r, ServoState) and truth.holds(i, r) for i, r in readings.items())
    assert quick == [True] * 5
    assert len(port.sent) == 10 and len(set(port.sent)) == 2
    assert [packet[7] == wire.SYNC_WRITE for packet in port.sent] == [False, True] * 5
    assert line.account(1).replies == replies + 5


FAULTS: dict[str, Callable[[Line], object]] = {
    "silent": lambda line: line.faults.silence(3),
    "silent last": lambda line: line.faults.silence(7),
    "all silent": lambda line: [line.faults.silence(i) for i in IDS],
    "corrupt": lambda line: line.faults.corrupt_next(3),
    "late": lambda line: line.faults.delay_next(3),
}


@each_kind
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_switches_to_separate_decoding_and_goals_are_sent_once(
    kind: Kind, fault: str, quick: list[bool]
) -> None:
    line, port = steady_line(kind)
    quick.clear()
    FAULTS[fault](line)
    line.goals = {i: ServoGoal(2000 + i) for i in IDS}
    readings = line.cycle()
    assert quick[0] is False
    assert sum(packet[7] == wire.SYNC_WRITE for packet in port.sent) == 1
    wrong = {i for i, reading in readings.items() if isinstance(reading, ServoFault)}
    assert wrong <= (set(IDS) if "all" in fault else {3, 7})
    for servo_id in IDS:
        line.faults.restore(servo_id)
    if fault != "all silent":  # a silent servo receives nothing
        assert line.held(5, x.goal_position) == 2005
    for _ in range(120):
        line.cycle()
    assert line.missing() == {}
    assert quick[-1]


@each_kind
def test_a_single_delay_of_the_adapter_costs_no_state(kind: Kind, quick: list[bool]) -> None:
    line, port = steady_line(kind, fast=False)
    quick.clear()
    port.hold_s = 0.009
    readings = line.states(line.clock.now() + 0.05)
    assert quick and not any(quick)
    assert all(isinstance(reading, ServoState) for reading in readings.values())
    assert line.account(1).silent == 0


@each_kind
def test_the_wait_for_a_silent_servo_ends_at_the_deadline(kind: Kind, quick: list[bool]) -> None:
    line, _ = steady_line(kind)
    for servo_id in IDS:
        line.faults.silence(servo_id)
    quick.clear()
    deadline_s = line.clock.now() + kind.table.budget_s
    assert all(isinstance(reading, ServoFault) for reading in line.states(deadline_s).values())
    assert not any(quick)
    assert line.clock.now() <= deadline_s


@each_kind
def test_alarms_are_named_and_counted_in_every_cycle(kind: Kind) -> None:
    line, _ = steady_line(kind)
    line.bus.write(3, x.max_voltage_limit, 110)
    for cycles in (1, 2, 3):
        line.clock.sleep_until(line.clock.now() + 0.2)
        reading = line.cycle()[3]
        assert isinstance(reading, ServoState) and reading.alarms == ("voltage",)
        assert (line.account(3).alarms, line.account(4).alarms) == (cycles, 0)


@each_kind
def test_input_left_by_a_single_read_is_discarded(kind: Kind) -> None:
    line, port = steady_line(kind)
    line.bus.read(2, x.present_position)
    port.give(b"\x00\xff\x12")
    assert line.missing() == {}
    assert line.bus.counters.noise == 0


@each_kind
def test_different_servos_get_a_different_request(kind: Kind, quick: list[bool]) -> None:
    line, _ = steady_line(kind)
    quick.clear()
    goals = {i: line.goals[i] for i in (2, 5)}
    for _ in range(2):
        assert list(exchange(line.bus, goals, (2, 5), line.clock.now() + 0.02)) == [2, 5]
    assert quick == [True, True]


def test_an_identified_servo_gets_a_new_request(quick: list[bool]) -> None:
    """The request is shorter because its indirect registers are mapped."""
    (kind,) = DIRECT
    line, port = steady_line(kind)
    assert line.missing() == {}
    before = port.sent[-2]
    for servo_id in IDS:
        line.bus.identify(servo_id, kind.models[servo_id])
    quick.clear()
    assert line.missing() == {}
    assert port.sent[-2] != before
    assert line.missing() == {} and quick == [True, True]


def test_a_servo_that_has_lost_its_map_is_reported_and_read_directly() -> None:
    (kind,) = MAPPED
    line, port = steady_line(kind)
    assert line.missing() == {}
    question = port.sent[-2]
    port.write(wire.packet(3, Code.REBOOT, b""))
    seen = {fault for _ in range(200) for fault in line.missing().items()}
    assert seen and {servo_id for servo_id, _ in seen} == {3}
    line.bus.torque_on(3)
    line.clock.sleep_until(line.clock.now() + OPEN_S)
    port.sent = ()
    assert line.missing() == {}
    assert port.sent[0] == question, [p.hex() for p in port.sent] + [question.hex()]


def test_a_miss_counts_once_against_the_map() -> None:
    """The miss is not counted again when the servo answers later reads, which have no deadline."""
    (kind,) = MAPPED
    line, _ = steady_line(kind)
    assert isinstance(line.bus, Bus)
    line.faults.silence(3)
    assert line.missing() == {3: "silent"}
    line.faults.restore(3)
    for _ in range(10):
        assert all(isinstance(reading, ServoState) for reading in line.bus.read_states(IDS).values())
        assert 3 in line.bus._servos.mapped
