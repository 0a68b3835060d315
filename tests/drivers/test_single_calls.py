"""What one servo is asked by itself: a late answer is nobody's, and our own bytes are no answer. For every make."""

from dataclasses import dataclass

import pytest

from drivers.bus.bus import Bus
from drivers.bus.late_replies import HELD_S
from drivers.errors import ServoCorrupt, ServoError, ServoSilent
from drivers.servos import ax_mx as dxl
from drivers.servos import scs, sts, x, xl320
from drivers.servos.catalog import series_of
from drivers.servos.register import Register, ServoModel
from sim_backend.clock import SimulatedClock
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.sts.servo import VirtualServo
from sim_backend.wire.bus import VirtualBus
from sim_backend.wire.dynamixel_bus import VirtualDynamixelBus
from tests.drivers.ports import WatchedPort

LATE_S = 0.045
"""Beyond what an SDK waits."""


@dataclass(frozen=True)
class Case:
    """A model, and registers of one size and of another."""

    model: ServoModel
    temperature: Register
    torque: Register
    position: Register


CASES = (
    Case(sts.STS3215, sts.present_temperature, sts.torque_enable, sts.present_position),
    Case(scs.SCS0009, scs.present_temperature, scs.torque_enable, scs.present_position),
    Case(dxl.AX_12A, dxl.present_temperature, dxl.torque_enable, dxl.present_position),
    Case(x.XL430_W250, x.present_temperature, x.torque_enable, x.present_position),
    Case(xl320.XL320, xl320.present_temperature, xl320.torque_enable, xl320.present_position),
)
every_case = pytest.mark.parametrize("case", CASES, ids=lambda case: case.model.name)


class NoisyPort(WatchedPort):
    """Puts bytes that nobody sent before the echo of ours."""

    noise = b""

    def write(self, data: bytes) -> None:
        self.give(self.noise)
        super().write(data)


class Bench:
    """One servo, limp and 30 degrees warm."""

    def __init__(self, case: Case) -> None:
        self.clock = SimulatedClock(10.0)
        x_series = series_of(case.model).protocol.name == "Dynamixel protocol 2.0"
        of = VirtualDynamixelBus.of if x_series else VirtualBus.of
        self.servos = of(BenchPlant((1,)), {1: case.model})
        self.port = NoisyPort(self.servos, self.clock)
        self.bus: Bus = Bus(self.port, self.clock, {1: case.model})

    def held(self, register: Register) -> int:
        return self.servos.servo(1).memory.get(register)

    def alarm(self) -> None:
        """The servo's next answers say that its voltage is wrong."""
        servo = self.servos.servo(1)
        if isinstance(servo, VirtualServo):
            servo.memory.put(sts.min_voltage, 200)
            self.clock.sleep_until(self.clock.now() + 0.002)
        else:
            servo.firmware.protection.status |= 1

    def late(self, register: Register) -> None:
        """A read whose answer comes too late."""
        self.port.hold_s = LATE_S
        with pytest.raises(ServoSilent):
            self.bus.read(1, register)
        self.port.hold_s = 0.0


@every_case
def test_a_late_answer_is_not_taken_for_that_of_another_register(case: Case) -> None:
    bench = Bench(case)
    bench.late(case.temperature)
    assert bench.held(case.temperature) != bench.held(case.torque) == 0
    assert bench.bus.read(1, case.torque) == 0


@every_case
@pytest.mark.parametrize("register", ["temperature", "position"])
def test_a_late_answer_acknowledges_no_write(case: Case, register: str) -> None:
    bench = Bench(case)
    bench.late(getattr(case, register))
    bench.servos.faults.silence(1)
    with pytest.raises(ServoSilent):
        bench.bus.write(1, case.torque, 0)


@every_case
def test_after_an_interrupt_its_answer_is_nobodys(case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(case)

    def interrupted(size: int, deadline_s: float) -> bytes:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(bench.port, "read", interrupted)
        with pytest.raises(KeyboardInterrupt):
            bench.bus.read(1, case.temperature)
    # No discarding helps where it is still on its way.
    assert bench.bus.read(1, case.torque) == 0


@every_case
def test_a_silent_servo_costs_its_owed_answer_and_no_more(case: Case) -> None:
    bench = Bench(case)
    bench.servos.faults.silence(1)
    begin_s = bench.clock.now()
    for _ in range(3):
        with pytest.raises(ServoError):
            bench.bus.read(1, case.torque)
    assert bench.clock.now() - begin_s < 3 * 0.05 + 2 * HELD_S
    bench.servos.faults.restore(1)
    assert bench.bus.read(1, case.torque) == 0


@every_case
@pytest.mark.parametrize("noise", [b"\x00", b"\xff", b"\xff\xff\x01", b"\x00" * 5], ids=bytes.hex)
@pytest.mark.parametrize("learnt", [True, False], ids=["learnt", "new"])
def test_noise_before_an_echo_makes_no_answer_of_our_request(case: Case, noise: bytes, learnt: bool) -> None:
    bench = Bench(case)
    bench.port.echoes = True
    if learnt:
        bench.bus.read(1, case.torque)
    bench.port.noise = noise
    try:
        assert bench.bus.read(1, case.position) == bench.held(case.position)
    except ServoCorrupt:  # where nobody knows of the echo yet
        assert not learnt
    assert bench.bus.read(1, case.position) == bench.held(case.position)
    bench.servos.faults.silence(1)
    for register in (case.position, case.torque):
        with pytest.raises(ServoError):
            bench.bus.read(1, register)
    with pytest.raises(ServoError):
        bench.bus.write(1, case.torque, 0)
    assert len(bench.bus.torque_off([1])) == 1


@every_case
@pytest.mark.parametrize("known", [True, False], ids=["no echo", "perhaps an echo"])
def test_an_answer_may_end_like_the_beginning_of_a_request(case: Case, known: bool) -> None:
    bench = Bench(case)
    if known:
        bench.bus.read_states((1,), bench.clock.now() + 0.05)
    for held in range(256):  # every checksum
        bench.servos.servo(1).memory.put(case.torque, held)
        begin_s = bench.clock.now()
        assert bench.bus.read(1, case.torque) == held
        assert bench.clock.now() - begin_s < 0.005


@every_case
def test_in_a_cycle_nobody_waits_for_a_late_answer_and_the_next_question_has_its_time(case: Case) -> None:
    bench = Bench(case)
    bench.late(case.temperature)
    for _ in range(60):  # at 200 Hz: where a question's time is spent on waiting, the servo owes an answer for ever
        begin_s = bench.clock.now()
        try:
            assert bench.bus.torque_states((1,), begin_s + 0.0025) == {1: False}
            return
        except AssertionError:
            assert bench.clock.now() == begin_s
        bench.clock.sleep_until(begin_s + 0.005)
    pytest.fail("it was never asked again")


@every_case
@pytest.mark.parametrize("noise", [b"\xff", b"\x00", b"\xff\xff\x01\x04\x00"], ids=bytes.hex)
def test_on_a_line_that_is_never_silent_a_question_ends(
    case: Case, noise: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = Bench(case)
    begin_s = bench.clock.now()

    def endless(size: int, deadline_s: float) -> bytes:
        assert bench.clock.now() < begin_s + 0.5, "it never ends"
        bench.clock.sleep_until(bench.clock.now() + size * 1e-5)
        return (noise * size)[:size]

    monkeypatch.setattr(bench.port, "read", endless)
    with pytest.raises(ServoError):
        bench.bus.read(1, case.position)


@every_case
def test_each_question_to_one_servo_ends_in_one_counter(case: Case) -> None:
    bench = Bench(case)
    account = bench.bus.counters.of(1)
    bench.bus.write(1, case.torque, 0)
    bench.alarm()
    bench.bus.read(1, case.torque)
    assert (account.replies, account.alarms) == (2, 1)
    bench.servos.faults.corrupt_next(1)
    with pytest.raises(ServoCorrupt):
        bench.bus.read(1, case.torque)
    assert account.corrupt == 1
    bench.port.hold_s = HELD_S + LATE_S
    with pytest.raises(ServoSilent):
        bench.bus.read(1, case.temperature)
    assert account.silent == 1
    bench.port.hold_s = 0.0
    with pytest.raises(ServoCorrupt, match=f"sent 1 byte in reply to {case.position.name}"):
        bench.bus.read(1, case.position)
    assert account.late == 1
    assert sum(account.as_dict().values()) == 2 + 1 + 3


@pytest.mark.parametrize(
    "case", [case for case in CASES if series_of(case.model).protocol.name != "Dynamixel protocol 2.0"][1:]
)
def test_the_wait_for_a_late_answer_teaches_no_patience(case: Case) -> None:
    bench = Bench(case)
    bench.bus.read_states((1,))
    bench.late(case.temperature)
    bench.bus.read(1, case.torque)
    begin_s = bench.clock.now()
    bench.servos.faults.silence(1)
    bench.bus.read_states((1,), begin_s + 0.1)
    assert bench.clock.now() - begin_s < 0.015  # in which the adapter of a slow line would not have answered once
