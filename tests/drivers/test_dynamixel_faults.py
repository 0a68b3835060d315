"""A bad line, thousands of cycles long, and every single fault by itself: nothing wrong is ever believed."""

import os
from collections import Counter

import pytest

from drivers.bus import ServoFault, ServoGoal, ServoState
from drivers.counters import ServoCounters
from drivers.dynamixel import state, wire
from drivers.dynamixel import x_series as x
from drivers.dynamixel.bus import DynamixelBus
from drivers.dynamixel.models import X
from sim_backend.clock import SimulatedClock
from sim_backend.dynamixel_bus import VirtualDynamixelBus
from sim_backend.dynamixel_wire import status_packet
from sim_backend.faults import Disturbance
from sim_backend.plant import BenchPlant
from sim_backend.port import VirtualPort

IDS = (1, 2, 3, 4, 5, 6, 7)
PERIOD_S = 0.015
BUDGET_S = 0.012
CYCLES = int(os.environ.get("SERVOLOOP_FAULT_CYCLES", "2000"))
MODELS = {i: x.XL430_W250 if i % 2 else x.XM430_W350 for i in IDS}

BLOCK = X.blocks[0]


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


class Line:
    def __init__(self, port: type[VirtualPort] = VirtualPort) -> None:
        self.clock = SimulatedClock(50.0)
        self.servos = VirtualDynamixelBus.of(BenchPlant(IDS), MODELS)
        self.faults = self.servos.faults
        self.bus = DynamixelBus(port(self.servos, self.clock), self.clock)

    def account(self, servo_id: int) -> ServoCounters:
        return self.bus.counters.of(servo_id)

    def cycle(self) -> dict[int, ServoState | ServoFault]:
        next_s = self.clock.now() + PERIOD_S
        readings = self.bus.read_states(IDS, self.clock.now() + BUDGET_S)
        self.clock.sleep_until(next_s)
        return readings

    def missing(self) -> dict[int, str]:
        return {i: r.kind for i, r in self.cycle().items() if isinstance(r, ServoFault)}


class Truth:
    """State registers that say the servo and the time, so that a wrong or an old value shows."""

    def __init__(self, line: Line) -> None:
        self.line = line
        self.number = 0
        for servo in line.servos.servos:
            servo.read_status = self._status_of(servo.servo_id)  # type: ignore[method-assign]

    def _status_of(self, servo_id: int):  # type: ignore[no-untyped-def]
        def read_status(address: int, size: int) -> bytes:
            table = bytearray(bytes(x.STATE_BLOCK_END))
            for register, value in (
                (x.present_position, self._position(servo_id)),
                (x.present_pwm, -servo_id),
                (x.present_voltage, 120),
                (x.present_temperature, 30),
            ):
                table[register.address : register.address + register.size] = register.encode(value, "little")
            return status_packet(servo_id, 0, bytes(table[address : address + size]))

        return read_status

    def _position(self, servo_id: int) -> int:
        return self.number * 7 - servo_id * 1000

    def holds(self, servo_id: int, reading: ServoState) -> bool:
        return reading == (self._position(servo_id), 0, -servo_id / x.FULL_PWM, pytest.approx(12.0), 30.0, ())


def test_thousands_of_cycles_on_a_bad_line() -> None:
    """Every value is the right one of this very cycle, and the counters say what was done to the line."""
    line = Line()
    truth = Truth(line)
    line.faults.disturbance = done = Disturbance(seed=3, drop=0.05, flip=0.02, noise=0.02)
    states = 0
    for number in range(CYCLES):
        truth.number = number
        for servo_id, reading in line.cycle().items():
            if isinstance(reading, ServoState):
                states += 1
                assert truth.holds(servo_id, reading), (number, servo_id)
    for servo_id in IDS:
        account = line.account(servo_id)
        injected = done.done["drop", servo_id] + done.done["flip", servo_id]
        assert account.silent + account.corrupt + account.late == injected
        assert account.silent == pytest.approx(done.done["drop", servo_id], rel=0.05)
        assert account.retries > 0
    noise = sum(count for (kind, _), count in done.done.items() if kind == "noise")
    assert line.bus.counters.noise == pytest.approx(noise, rel=0.05)
    assert states > 0.99 * CYCLES * len(IDS)


def test_a_lost_reply_is_asked_for_again_in_the_same_cycle() -> None:
    line = Line()
    line.faults.corrupt_next(3)
    assert line.missing() == {}
    account = line.account(3)
    assert (account.corrupt, account.retries, account.replies) == (1, 1, 1)


def test_without_time_nothing_is_asked_again() -> None:
    line = Line()
    line.faults.corrupt_next(3)
    readings = line.bus.read_states(IDS, line.clock.now() + 0.0031)
    assert isinstance(readings[3], ServoFault)
    assert line.account(3).retries == 0


def test_the_deadline_ends_the_wait_of_a_dead_line() -> None:
    line = Line()
    for servo_id in IDS:
        line.faults.silence(servo_id)
    begin_s = line.clock.now()
    line.bus.read_states(IDS, begin_s + 0.004)
    assert line.clock.now() <= begin_s + 0.0041


@pytest.mark.parametrize("silent", IDS)
def test_a_servo_known_to_be_silent_is_reported_always_and_asked_seldom(silent: int) -> None:
    line = Line()
    line.faults.silence(silent)
    assert all(line.missing() == {silent: "silent"} for _ in range(300))
    account = line.account(silent)
    assert account.silent + account.skipped == 300 + account.retries
    assert account.skipped > 280


@pytest.mark.parametrize("silent", IDS)
def test_a_servo_that_is_back_is_read_within_a_second(silent: int) -> None:
    line = Line()
    line.faults.silence(silent)
    for _ in range(500):
        line.cycle()
    line.faults.restore(silent)
    assert any(line.missing() == {} for _ in range(100))
    assert line.missing() == {}


def test_the_whole_line_comes_back_too() -> None:
    line = Line()
    for servo_id in IDS:
        line.faults.silence(servo_id)
    for _ in range(200):
        assert len(line.missing()) == len(IDS)
    for servo_id in IDS:
        line.faults.restore(servo_id)
    for _ in range(100):
        line.cycle()
    assert line.missing() == {}


@pytest.mark.parametrize("servo_id", IDS)
def test_a_late_reply_is_never_taken_for_the_present_one(servo_id: int) -> None:
    line = Line()
    truth = Truth(line)
    for number in range(50):
        truth.number = number
        if number % 5 == 0:
            line.faults.delay_next(servo_id)
        for i, reading in line.cycle().items():
            assert not isinstance(reading, ServoState) or truth.holds(i, reading)
        truth.number += 1  # whatever arrives from now on is old
    assert line.account(servo_id).late > 0
    assert line.missing() == {}


def test_an_adapter_that_echoes_is_understood() -> None:
    line = Line(EchoingPort)
    assert line.bus.read(2, x.present_position) == 2048
    line.bus.torque_on(2)
    for _ in range(20):
        line.bus.write_goals({i: ServoGoal(2050) for i in IDS})
        assert line.missing() == {}
    line.faults.silence(4)
    assert line.missing() == {4: "silent"}
    assert line.bus.goal(2) == 2050
    assert set(line.bus.exchange({1: ServoGoal(2060)}, IDS, line.clock.now() + 0.01)) == set(IDS)
    assert line.bus.goal(1) == 2060


def test_goals_and_states_go_out_together() -> None:
    line = Line()
    readings = line.bus.exchange({i: ServoGoal(2100 + i, 50) for i in IDS}, IDS, line.clock.now() + 0.01)
    assert all(isinstance(reading, ServoState) for reading in readings.values())
    assert [line.bus.goal(i) for i in IDS] == [2100 + i for i in IDS]


def test_alarms_are_named_and_counted() -> None:
    line = Line()
    line.servos.servo(3).firmware.protection.status |= 1 << 5
    reading = line.cycle()[3]
    assert isinstance(reading, ServoState)
    assert reading.alarms == ("overload",)
    assert line.account(3).alarms == 1
    assert line.missing() == {}


def test_an_alarm_that_is_not_explained_in_time_does_not_cost_the_deadline() -> None:
    line = Line()
    line.servos.servo(3).firmware.protection.status |= 1 << 5
    receive = line.servos.receive

    def deaf_to_reads(data: bytes, now_s: float, baud: int = 1_000_000):  # type: ignore[no-untyped-def]
        return [] if data[7] == wire.READ else receive(data, now_s, baud)

    line.servos.receive = deaf_to_reads  # type: ignore[method-assign]
    begin_s = line.clock.now()
    reading = line.bus.read_states(IDS, begin_s + BUDGET_S)[3]
    assert isinstance(reading, ServoState)
    assert reading.alarms == ("hardware error",)
    assert line.clock.now() <= begin_s + BUDGET_S + 1e-4


def test_fast_and_slow_ways_give_the_same_states_and_no_flipped_bit_passes() -> None:
    blocks = [bytes((i * 37 + n * 11) & 0x7F for n in range(BLOCK.size)) for i in IDS]
    data = b"".join(status_packet(i, 0x80 * (i == 3), block) for i, block in zip(IDS, blocks, strict=True))
    fast = state.burst(data, IDS, BLOCK)
    replies = wire.ReplyDecoder(BLOCK.size).feed(data)
    assert fast == {r.servo_id: BLOCK.decode(r.error, r.data) for r in replies}
    spoiled = bytearray(data)
    counts: Counter[bool] = Counter()
    for bit in range(len(spoiled) * 8):
        spoiled[bit // 8] ^= 1 << bit % 8
        counts[state.burst(bytes(spoiled), IDS, BLOCK) is None] += 1
        spoiled[bit // 8] ^= 1 << bit % 8
    assert counts == {True: len(spoiled) * 8}


def test_a_stuffed_reply_and_a_longer_block_are_understood() -> None:
    longer = X.blocks[2]
    content = b"\xff\xff\xfd" + bytes(longer.size - 3)
    data = status_packet(1, 0, content)
    assert state.burst(data, (1,), longer) is None
    (reply,) = wire.ReplyDecoder(longer.size).feed(data)
    assert longer.decode(reply.error, reply.data) == (0, 0, 0.0, 0.0, 0.0, ())
