"""Requests to a single servo, for every make: late replies and echoes of requests are not accepted as replies."""

from dataclasses import dataclass
from typing import Any

import pytest

from drivers.bus.bus import Bus
from drivers.bus.late_replies import HELD_S
from drivers.driver_errors import ServoCorrupt, ServoError, ServoSilent
from drivers.servos import ax_mx as dxl
from drivers.servos import scs, sts, x, xl320
from drivers.servos.catalog import series_of
from drivers.servos.register import Register, ServoModel
from drivers.types import ServoState
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.feetech import VirtualBus
from sim_backend.clock import SimulatedClock
from sim_backend.line.line import ServoLine
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.servos.sts.servo import VirtualServo
from tests.drivers.ports import WatchedPort

LATE_S = 0.045
"""Delay beyond the timeout of an SDK, in seconds."""


@dataclass(frozen=True)
class Case:
    """A model, and registers of equal and of different size."""

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
    """A port that inserts noise before the echo of a request."""

    noise = b""

    def write(self, data: bytes) -> None:
        self.give(self.noise)
        super().write(data)


class Bench:
    """One servo without torque, at 30 °C."""

    def __init__(self, case: Case) -> None:
        self.clock = SimulatedClock(10.0)
        x_series = series_of(case.model).protocol.name == "Dynamixel protocol 2.0"
        of = VirtualDynamixelBus.of if x_series else VirtualBus.of
        self.servos: ServoLine[Any] = of(BenchPlant((1,)), {1: case.model})
        self.port = NoisyPort(self.servos, self.clock)
        self.bus: Bus = Bus(self.port, self.clock, {1: case.model})

    def held(self, register: Register) -> int:
        return self.servos.servo(1).memory.get(register)

    def alarm(self) -> None:
        """Make the servo's next replies report a voltage alarm."""
        servo = self.servos.servo(1)
        if isinstance(servo, VirtualServo):
            servo.memory.put(sts.min_voltage, 200)
            self.clock.sleep_until(self.clock.now() + 0.002)
        else:
            servo.firmware.protection.status |= 1

    def late(self, register: Register) -> None:
        """Make a read whose reply arrives too late."""
        self.port.hold_s = LATE_S
        with pytest.raises(ServoSilent):
            self.bus.read(1, register)
        self.port.hold_s = 0.0


@every_case
def test_a_late_reply_is_not_taken_for_the_value_of_another_register(case: Case) -> None:
    bench = Bench(case)
    bench.late(case.temperature)
    assert bench.held(case.temperature) != bench.held(case.torque) == 0
    assert bench.bus.read(1, case.torque) == 0


@every_case
@pytest.mark.parametrize("register", ["temperature", "position"])
def test_a_late_reply_does_not_acknowledge_a_write(case: Case, register: str) -> None:
    bench = Bench(case)
    bench.late(getattr(case, register))
    bench.servos.faults.silence(1)
    with pytest.raises(ServoSilent):
        bench.bus.write(1, case.torque, 0)


@every_case
def test_a_reply_after_an_interrupt_is_discarded(case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(case)

    def interrupted(size: int, deadline_s: float) -> bytes:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(bench.port, "read", interrupted)
        with pytest.raises(KeyboardInterrupt):
            bench.bus.read(1, case.temperature)
    # Discarding input has no effect while the reply is still on its way.
    assert bench.bus.read(1, case.torque) == 0


@every_case
def test_a_silent_servo_costs_one_wait_for_a_late_reply(case: Case) -> None:
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
def test_noise_before_an_echo_does_not_turn_the_request_into_a_reply(case: Case, noise: bytes, learnt: bool) -> None:
    bench = Bench(case)
    bench.port.echoes = True
    if learnt:
        bench.bus.read(1, case.torque)
    bench.port.noise = noise
    try:
        assert bench.bus.read(1, case.position) == bench.held(case.position)
    except ServoCorrupt:  # the echo is not known yet
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
def test_an_adapter_that_begins_to_echo_does_not_turn_requests_into_replies(case: Case) -> None:
    """In protocol 1.0, a request for two bytes looks the same as a reply with two bytes."""
    bench = Bench(case)
    bench.bus.read_states((1,), bench.clock.now() + 0.05)  # no echo
    bench.port.echoes = True
    for register in (case.position, case.torque, case.temperature):
        assert bench.bus.read(1, register) == bench.held(register)
    for _ in range(2):
        readings = bench.bus.read_states((1,), bench.clock.now() + 0.05)
    assert isinstance(readings[1], ServoState)
    bench.port.echoes = False
    for register in (case.position, case.torque, case.temperature):
        try:
            assert bench.bus.read(1, register) == bench.held(register)
        except ServoError:  # the expected echo is missing
            assert bench.bus.read(1, register) == bench.held(register)
    bench.bus.ping(1)


@every_case
@pytest.mark.parametrize("known", [True, False], ids=["no echo", "perhaps an echo"])
def test_a_reply_may_end_like_the_start_of_a_request(case: Case, known: bool) -> None:
    bench = Bench(case)
    if known:
        bench.bus.read_states((1,), bench.clock.now() + 0.05)
    for held in range(256):  # every checksum
        bench.servos.servo(1).memory.put(case.torque, held)
        begin_s = bench.clock.now()
        assert bench.bus.read(1, case.torque) == held
        assert bench.clock.now() - begin_s < 0.005


@every_case
def test_a_cycle_does_not_wait_for_a_late_reply(case: Case) -> None:
    bench = Bench(case)
    bench.late(case.temperature)
    for _ in range(
        60
    ):  # at 200 Hz: if waits used up the time of the request, a late reply would always remain possible
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
def test_a_request_ends_on_a_flooded_bus(case: Case, noise: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
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
def test_each_single_request_is_counted_once(case: Case) -> None:
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
def test_the_wait_for_a_late_reply_does_not_lengthen_timeouts(case: Case) -> None:
    bench = Bench(case)
    bench.bus.read_states((1,))
    bench.late(case.temperature)
    bench.bus.read(1, case.torque)
    begin_s = bench.clock.now()
    bench.servos.faults.silence(1)
    bench.bus.read_states((1,), begin_s + 0.1)
    assert bench.clock.now() - begin_s < 0.015  # shorter than one reply through a slow adapter
