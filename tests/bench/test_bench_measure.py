"""Tests of the bytes that ``servoloop bench bus`` writes to servos, and of its figures, in simulated time."""

import math
from collections.abc import Sequence

import pytest

from drivers.bus.adaptive_timeout import FIRST_REPLY_S
from drivers.bus.bus import Bus
from drivers.driver_errors import DriverError, ServoRefused
from drivers.protocol import v1 as wire
from drivers.protocol import v2 as dynamixel_wire
from drivers.servos import ax_mx as dxl
from drivers.servos import scs, sts
from drivers.servos import x as x_series
from drivers.servos.catalog import MODELS
from drivers.servos.indirect import block_for
from drivers.servos.register import ServoModel
from drivers.types import ServoGoal
from servoloop.bench.bus import BusSpeed, measure, standing_still
from servoloop.bench.goals import present_goals
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.feetech import VirtualBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.mechanics.plant import BenchPlant
from tests.drivers.ports import WatchedPort

IDS = (1, 2, 3, 4, 5, 6, 7)
GOALS = {i: ServoGoal(2048) for i in IDS}


class Interrupted(VirtualPort):
    """Port on which servos receive nothing between two times."""

    from_s = 0.5
    to_s = 0.55

    def write(self, data: bytes) -> None:
        if not self.from_s <= self._clock.now() < self.to_s:
            super().write(data)


def measured(port: VirtualPort, cycles: int = 1000) -> BusSpeed:
    clock = port._clock
    bus = Bus(port, clock)
    return measure(bus, clock, IDS, GOALS, cycles)


def stand_still(bus: Bus, servo_ids: Sequence[int], model: ServoModel) -> dict[int, ServoGoal]:
    """Write goals to all servos that may receive one, even if their torque is disabled, and return the goals."""
    found = present_goals(bus, servo_ids, model)
    goals = found.held | found.limp
    bus.write_goals(goals)
    bus.read_states(servo_ids)
    return goals


def servos() -> VirtualBus:
    return VirtualBus.of(BenchPlant(IDS))


def test_an_interruption_costs_the_cycles_of_its_duration() -> None:
    """A servo that is known to be silent gets no request. Cycles without any request must not take zero time."""
    figures = measured(Interrupted(servos(), SimulatedClock(0.0)))
    assert 0 < figures.faults["silent"] < 7 * 60
    assert 1.0 <= figures.ratio < 1.2


def test_cycles_without_replies_count_as_one_long_cycle() -> None:
    port = Interrupted(servos(), SimulatedClock(0.0))
    port.to_s = 2.0
    figures = measured(port)
    run_s = port._clock.now()
    silent_s = min(port.to_s, run_s) - port.from_s
    # Each of these cycles waits as long as a slow adapter may take, and misses every servo.
    assert figures.faults["silent"] >= 7 * (silent_s // (FIRST_REPLY_S + figures.wire_us / 1e6))
    assert 1.0 <= figures.ratio < 1.2
    assert figures.hz == pytest.approx((run_s - silent_s) / run_s * 1e6 / figures.p50_us, rel=0.02)
    assert figures.max_us == pytest.approx(silent_s * 1e6, rel=0.02)


def test_a_run_without_replies_has_no_figures() -> None:
    port = Interrupted(servos(), SimulatedClock(0.0))
    port.from_s, port.to_s = 0.0, math.inf
    with pytest.raises(DriverError, match="no servo responds on virtual"):
        measured(port, 10)


def test_a_run_whose_only_cycle_was_lost_has_figures() -> None:
    port = Interrupted(servos(), SimulatedClock(0.0))
    port.from_s, port.to_s = 0.0, 0.04
    figures = measured(port, 1)
    assert figures.hz == 0.0 and figures.max_us == figures.p50_us > 0.0
    assert figures.faults["silent"] == 7 + figures.faults["retries"] > 7


def test_late_replies_from_before_the_run_are_not_counted() -> None:
    port = WatchedPort(servos(), SimulatedClock(0.0))
    clock, bus = port._clock, Bus(port, port._clock)
    port.hold_s = 0.06
    bus.read_states(IDS, clock.now() + 0.03)
    assert bus.counters.faults()["silent"] > 0
    port.hold_s = 0.0
    figures = measure(bus, clock, IDS, GOALS, 50)
    assert set(figures.faults.values()) == {0}


@pytest.mark.parametrize("late_s", [0.012, 0.016])
def test_a_slow_adapter_shows_in_the_figures(late_s: float) -> None:
    port = WatchedPort(servos(), SimulatedClock(0.0))
    port.hold_s = late_s
    figures = measured(port, 100)
    assert figures.faults["silent"] == 0
    assert figures.p50_us >= late_s * 1e6


def test_a_slow_line_is_not_taken_for_a_silent_line() -> None:
    """The transmission alone takes longer than the usual timeout of servos and adapter."""
    line = servos()
    for servo in line.servos:
        servo.memory.put(sts.baud_rate, sts.BAUD_RATES.index(38_400))
    figures = measured(VirtualPort(line, SimulatedClock(0.0), baud=38_400), 50)
    assert figures.faults["silent"] == 0
    # A cycle has 177 bytes. The first servo waits for one byte time before it replies. Each other servo waits for
    # three byte times after the previous reply.
    assert 1.0 <= figures.ratio <= 1.0 + 19 / 177


def test_the_baud_rate_of_silent_servos_is_reported() -> None:
    line, clock = servos(), SimulatedClock(0.0)
    for servo in line.servos:
        servo.memory.put(sts.baud_rate, sts.BAUD_RATES.index(500_000))
    port = VirtualPort(line, clock)
    with pytest.raises(DriverError, match=r"no servo responds on virtual: servo 1: responds at 500000 baud: set"):
        stand_still(Bus(port, clock), IDS, sts.STS3215)
    assert port.baud == 1_000_000


# Bytes written before the measurement


def goals_sent(port: WatchedPort) -> list[bytes]:
    return [packet for packet in port.sent if packet[4] == wire.SYNC_WRITE]


@pytest.mark.parametrize("model", ["mx-28", "ax-12a", "scs0009"])
def test_servos_with_another_table_are_refused_and_nothing_is_written(model: str) -> None:
    clock = SimulatedClock(0.0)
    port = WatchedPort(servos(), clock)
    bus = Bus(port, clock, dict.fromkeys(IDS, MODELS[model]))
    # At the addresses where the other table has the state, these servos have other registers, and their values look
    # like a state.
    with pytest.raises(ServoRefused, match="is model"):
        stand_still(bus, IDS, MODELS[model])
    assert not goals_sent(port)


AX_12A, SCS15_TURNED, OF_NOBODY, TURNED = 12, 0x0F05, 4321, 0x0903


@pytest.mark.parametrize(("number", "servo_id"), [(AX_12A, 7), (SCS15_TURNED, 7), (OF_NOBODY, 8)])
def test_a_servo_of_another_model_gets_no_goal(number: int, servo_id: int, caplog: pytest.LogCaptureFixture) -> None:
    """The servo has another model number, or its ID register is not at the address of this table."""
    line, clock = servos(), SimulatedClock(0.0)
    line.servo(7).memory.put(sts.model_number, number)
    read = line.servo(7).read
    where = sts.servo_id.address
    line.servo(7).read = lambda at, size: bytes((servo_id,)) if at == where else read(at, size)  # type: ignore[method-assign]
    port = WatchedPort(line, clock)
    assert set(stand_still(Bus(port, clock), IDS, sts.STS3215)) == set(IDS) - {7}
    assert f"servo 7: is model {number}" in caplog.text
    assert all(set(packet[7:-1:8]) == set(IDS) - {7} for packet in goals_sent(port))


@pytest.mark.parametrize("number", [sts.STS3250.number, OF_NOBODY, TURNED])
def test_a_servo_with_the_right_table_is_measured(number: int, caplog: pytest.LogCaptureFixture) -> None:
    """The servo has a different motor, an unknown model number, or the byte-swapped model number that a simulator may
    report."""
    line, clock = servos(), SimulatedClock(0.0)
    line.servo(7).memory.put(sts.model_number, number)
    assert set(stand_still(Bus(VirtualPort(line, clock), clock), IDS, sts.STS3215)) == set(IDS)
    assert f"servo 7: is model {number}" in caplog.text
    assert "the servo is still measured as this model" in caplog.text


@pytest.mark.parametrize("mode", [1, 2, 3])
@pytest.mark.parametrize("number", [sts.STS3250.number, OF_NOBODY])
def test_an_unknown_model_in_another_mode_gets_no_goal(number: int, mode: int) -> None:
    """In mode 3, a goal is a distance to move."""
    line, clock = servos(), SimulatedClock(0.0)
    line.servo(7).memory.put(sts.model_number, number)
    line.servo(7).memory.put(sts.operating_mode, mode)
    assert set(stand_still(Bus(VirtualPort(line, clock), clock), IDS, sts.STS3215)) == set(IDS) - {7}


@pytest.mark.parametrize("at_its_number", [True, False])
def test_a_servo_that_falls_silent_during_identification_gets_no_goal(at_its_number: bool) -> None:
    line, clock = servos(), SimulatedClock(0.0)
    line.servo(7).memory.put(sts.operating_mode, 3)
    last = sts.model_number if at_its_number else sts.operating_mode
    read = line.servo(7).read

    def once(at: int, size: int) -> bytes:
        if at == last.address:
            line.faults.silence(7)
        return read(at, size)

    line.servo(7).read = once  # type: ignore[method-assign]
    assert 7 not in stand_still(Bus(VirtualPort(line, clock), clock), IDS, sts.STS3215)


@pytest.mark.parametrize("model", ["scs0009", "ax-12a"])
def test_a_servo_at_an_invalid_goal_position_gets_no_goal(model: str, caplog: pytest.LogCaptureFixture) -> None:
    clock = SimulatedClock(0.0)
    line = VirtualBus.of(BenchPlant(IDS), dict.fromkeys(IDS, MODELS[model]))
    bus = Bus(VirtualPort(line, clock), clock, dict.fromkeys(IDS, MODELS[model]))
    position = scs.present_position if model == "scs0009" else dxl.present_position
    beyond = (1500).to_bytes(2, MODELS[model].byte_order)
    read = line.servo(3).read
    line.servo(3).read = (
        lambda at, size: (  # type: ignore[method-assign]
            beyond + read(at, size)[2:] if at == position.address else read(at, size)
        )
    )
    assert set(stand_still(bus, IDS, MODELS[model])) == set(IDS) - {3}
    assert "servo 3 is not sent a goal because its position 1500 is outside the goal range" in caplog.text


class Numberless(WatchedPort):
    """Simulated servos that answer only sync reads."""

    def write(self, data: bytes) -> None:
        if data[4] in (wire.SYNC_READ, wire.SYNC_WRITE):
            super().write(data)


def test_a_simulator_without_a_model_number_is_accepted() -> None:
    clock = SimulatedClock(0.0)
    bus = Bus(Numberless(servos(), clock), clock)
    goals = stand_still(bus, IDS, sts.STS3215)
    assert set(goals) == set(IDS)
    assert clock.now() < 4.0
    assert measure(bus, clock, IDS, goals, 20).faults["silent"] == 0


def test_a_single_servo_without_single_reads_is_not_taken_for_a_simulator() -> None:
    line, clock = servos(), SimulatedClock(0.0)
    line.servo(7).answer = lambda instruction: None  # type: ignore[method-assign]
    assert set(stand_still(Bus(VirtualPort(line, clock), clock), IDS, sts.STS3215)) == set(IDS) - {7}


def test_a_simulator_with_empty_memory_is_accepted() -> None:
    line, clock = servos(), SimulatedClock(0.0)
    for servo in line.servos:
        for register in (sts.model_number, sts.status_level, sts.operating_mode):
            servo.memory.put(register, 0)
    assert set(stand_still(Bus(VirtualPort(line, clock), clock), IDS, sts.STS3215)) == set(IDS)


def test_a_servo_in_another_mode_is_read_but_gets_no_goal(caplog: pytest.LogCaptureFixture) -> None:
    line, clock = servos(), SimulatedClock(0.0)
    line.servo(3).memory.put(sts.operating_mode, 3)  # in which a goal is a number of steps
    assert set(stand_still(Bus(VirtualPort(line, clock), clock), IDS, sts.STS3215)) == set(IDS) - {3}
    assert "servo 3: is not in position mode" in caplog.text


def test_a_servo_that_first_answers_during_the_run_gets_no_goal() -> None:
    line, clock = servos(), SimulatedClock(0.0)
    port = WatchedPort(line, clock)
    bus = Bus(port, clock)
    line.faults.silence(7)
    goals = stand_still(bus, IDS, sts.STS3215)
    line.faults.restore(7)
    figures = measure(bus, clock, IDS, goals, 500)
    assert figures.faults["silent"] < 400
    assert all(set(packet[7:-1:8]) == set(IDS) - {7} for packet in goals_sent(port))


def test_a_lost_reply_is_requested_again() -> None:
    line, clock = servos(), SimulatedClock(0.0)

    class Lossy(WatchedPort):
        def write(self, data: bytes) -> None:
            if data[4] != 2 or sum(packet[4] == 2 for packet in self.sent) % 3:
                super().write(data)
            else:
                self.sent += (data,)

    assert set(stand_still(Bus(Lossy(line, clock), clock), IDS, sts.STS3215)) == set(IDS)


def test_a_servo_that_holds_a_load_keeps_its_goal() -> None:
    """The sagged position must not become the goal, because the arm would then sink further with each measurement."""
    plant, clock = BenchPlant(IDS), SimulatedClock(0.0)
    line = VirtualBus.of(plant)
    bus = Bus(VirtualPort(line, clock), clock)
    bus.write_goals({1: GOALS[1], 2: GOALS[2]})  # this enables the torque of these servos; the third servo stays limp
    clock.sleep_until(0.1)
    plant.load_nm[0] = plant.load_nm[2] = 0.8
    clock.sleep_until(1.0)
    goals = stand_still(bus, IDS, sts.STS3215)
    assert line.servo(1).memory.get(sts.present_position) != 2048
    assert goals[1] == goals[2] == ServoGoal(2048)
    assert abs(goals[3].position_counts - 2048) > 100


def test_dynamixels_are_read_as_the_stack_reads_them() -> None:
    """The mapped block is read with one fast sync read."""
    model: ServoModel = x_series.XL430_W250
    clock = SimulatedClock(0.0)
    port = WatchedPort(VirtualDynamixelBus.of(BenchPlant(IDS), dict.fromkeys(IDS, model)), clock)
    bus = Bus(port, clock, dict.fromkeys(IDS, model))
    goals = stand_still(bus, IDS, model)
    assert set(goals) == set(IDS)
    before = len(port.sent)
    figures = measure(bus, clock, IDS, goals, 20)
    assert figures.faults["silent"] == 0
    block = block_for(model, 45)
    assert block is not None
    question = dynamixel_wire.fast_sync_read(IDS, block.address, block.size)
    assert set(port.sent[before::2]) == {question}  # without the goals between them


# Torque


def with_torque(line: VirtualBus) -> set[int]:
    return {servo.servo_id for servo in line.servos if servo.memory.get(sts.torque_enable)}


@pytest.mark.parametrize("hold", [False, True])
def test_limp_servos_are_only_read_unless_hold_is_given(hold: bool, caplog: pytest.LogCaptureFixture) -> None:
    line, clock = servos(), SimulatedClock(0.0)
    port = WatchedPort(line, clock)
    bus = Bus(port, clock)
    bus.write_goals({3: ServoGoal(2048)})
    bus.torque_on(3)
    del port.sent
    with standing_still(bus, IDS, sts.STS3215, hold=hold) as goals:
        assert set(goals) == (set(IDS) if hold else {3})
        measure(bus, clock, IDS, goals, 5)
        assert with_torque(line) == set(goals)
    assert with_torque(line) == {3}
    assert ("the torque of servos 1, 2, 4, 5, 6, 7 is off" in caplog.text) is not hold
    assert goals_sent(port)


@pytest.mark.parametrize("error", [KeyboardInterrupt, DriverError])
def test_held_servos_are_released_however_the_run_ends(error: type[BaseException]) -> None:
    line, clock = servos(), SimulatedClock(0.0)
    bus = Bus(VirtualPort(line, clock), clock)
    with pytest.raises(error), standing_still(bus, IDS, sts.STS3215, hold=True):
        line.advance(clock.now() + 0.01)
        assert with_torque(line) == set(IDS)
        raise error
    assert not with_torque(line)


@pytest.mark.parametrize("error", [None, KeyboardInterrupt, DriverError])
@pytest.mark.parametrize("lost", [False, True], ids=["a silent servo", "a lost port"])
def test_a_servo_that_cannot_be_released_is_an_error(lost: bool, error: type[BaseException] | None) -> None:
    line, clock = servos(), SimulatedClock(0.0)
    port = VirtualPort(line, clock)
    bus = Bus(port, clock)
    with pytest.raises(error or DriverError) as raised, standing_still(bus, IDS, sts.STS3215, hold=True):
        line.advance(clock.now() + 0.01)
        if lost:
            port.unplug()
        else:
            line.faults.silence(2)
        if error:
            raise error
    assert with_torque(line) == (set(IDS) if lost else {2})
    said = raised.value.__notes__[0] if error else str(raised.value)
    assert "torque may still be on: " in said and ("unplugged" in said if lost else "servo 2: does not" in said)
