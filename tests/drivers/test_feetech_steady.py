"""Cycles of an STS bus without faults: no state is lost, no goal is sent twice, and no outdated reply is accepted."""

from collections.abc import Callable

import pytest

from drivers.bus.bus import Bus
from drivers.driver_errors import ServoSilent
from drivers.protocol import v1 as wire
from drivers.servos import sts
from drivers.types import Reading, ServoGoal, ServoState
from sim_backend.buses.feetech import VirtualBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.mechanics.plant import BenchPlant
from tests.drivers.cycles import exchange
from tests.drivers.fault_lines import IDS, KINDS, Line, Truth
from tests.drivers.ports import WatchedPort

KIND = next(kind for kind in KINDS if kind.with_goals)
GOALS = bytes((wire.BROADCAST_ID, len(IDS) * 8 + 4, wire.SYNC_WRITE))


def steady_line() -> tuple[Line, WatchedPort]:
    line = Line(KIND, WatchedPort)
    assert isinstance(line.port, WatchedPort)
    assert line.missing() == {}
    line.port.sent = ()
    return line, line.port


def test_a_cycle_is_one_request_and_one_packet_of_goals() -> None:
    line, port = steady_line()
    replies = line.account(1).replies
    for _ in range(5):
        assert line.missing() == {}
    assert [packet[2:5] == GOALS for packet in port.sent] == [False, True] * 5
    assert line.account(1).replies == replies + 5


FAULTS: dict[str, Callable[[Line], None]] = {
    "silent": lambda line: line.faults.silence(3),
    "silent last": lambda line: line.faults.silence(7),
    "all silent": lambda line: [line.faults.silence(i) for i in IDS] and None,
    "corrupt": lambda line: line.faults.corrupt_next(3),
    "late": lambda line: line.faults.delay_next(3),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_goals_are_sent_once_whatever_happens_to_the_replies(fault: str) -> None:
    line, port = steady_line()
    FAULTS[fault](line)
    line.goals = {i: ServoGoal(2000 + i) for i in IDS}
    line.cycle()
    assert sum(packet[2:5] == GOALS for packet in port.sent) == 1
    for servo_id in IDS:
        line.faults.restore(servo_id)
    if fault != "all silent":
        assert line.held(5, sts.goal_position) == 2005


def test_a_single_delay_of_the_adapter_costs_no_state() -> None:
    line, port = steady_line()
    port.hold_s = 0.009
    readings = line.states(line.clock.now() + 0.05)
    assert all(isinstance(reading, ServoState) for reading in readings.values())
    assert line.account(1).silent == 0


def test_alarms_are_counted_in_every_cycle() -> None:
    line, _ = steady_line()
    line.bus.write(3, sts.max_voltage, 50)
    line.clock.sleep_until(line.clock.now() + 0.1)
    for cycles in (1, 2, 3):  # the first cycle discards input, because a request to a single servo preceded it
        reading = line.cycle()[3]
        assert isinstance(reading, ServoState) and reading.alarms == ("voltage",)
        assert (line.account(3).alarms, line.account(4).alarms) == (cycles, 0)


def test_an_old_reply_of_a_single_servo_is_not_accepted() -> None:
    """Only its length distinguishes the late reply from the new reply. The late reply arrives after the fault has
    ended."""
    line, port = steady_line()
    truth = Truth(line)
    take_held, line.faults.take_held = line.faults.take_held, bytes  # type: ignore[method-assign]

    def state() -> Reading:
        return exchange(line.bus, {1: ServoGoal(500)}, (1,), line.clock.now() + 0.05)[1]

    for _ in range(2):
        assert truth.holds(1, state())
    line.faults.delay_next(1)
    assert truth.holds(1, state())  # the request was repeated
    port.give(take_held())
    truth.number += 1
    assert truth.holds(1, state())
    assert line.account(1).late == 1


def test_input_left_by_a_single_read_is_discarded() -> None:
    line, port = steady_line()
    line.faults.silence(2)
    with pytest.raises(ServoSilent):
        line.bus.read(2, sts.present_position)
    line.faults.restore(2)
    port.give(b"\x00\xff\x12")
    assert line.missing() == {}
    assert line.bus.counters.noise == 0


def test_more_servos_than_fit_into_a_goal_packet_can_be_read() -> None:
    ids, clock = tuple(range(1, 41)), SimulatedClock(50.0)
    servos = VirtualBus.of(BenchPlant(ids, timestep_s=0.005), dict.fromkeys(ids, sts.STS3215))
    bus = Bus(VirtualPort(servos, clock), clock)
    for _ in range(2):
        assert all(isinstance(r, ServoState) for r in bus.read_states(ids, clock.now() + 0.1).values())
