"""The bus with virtual servos on a simulated clock, and with a port that returns scripted replies."""

from collections.abc import Callable
from dataclasses import dataclass, field

import pytest

from drivers.bus.adaptive_timeout import FIRST_REPLY_S
from drivers.bus.bus import Bus
from drivers.bus.retry import ATTEMPTS
from drivers.driver_errors import DriverError, PortLost, ServoCorrupt, ServoError, ServoRefused, ServoSilent
from drivers.port import Port
from drivers.protocol import v1 as wire
from drivers.servos import sts
from drivers.servos.register import Register
from drivers.types import ServoFault, ServoGoal, ServoState
from sim_backend.buses.feetech import VirtualBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.servos.sts.memory import StsMemory
from tests.drivers.cycles import exchange
from tests.drivers.tape import ScriptedPort

IDS = (1, 2, 3, 4, 5, 6, 7)


@dataclass
class Line:
    """A bus of virtual servos with its port, clock and faults."""

    clock: SimulatedClock = field(default_factory=lambda: SimulatedClock(100.0))
    servos: VirtualBus = field(default_factory=lambda: VirtualBus.of(BenchPlant(IDS)))

    def __post_init__(self) -> None:
        self.port = VirtualPort(self.servos, self.clock)
        self.bus = Bus(self.port, self.clock)

    def held(self, servo_id: int, register: Register) -> int:
        return self.servos.servo(servo_id).memory.get(register)


def scripted(*answers: bytes) -> tuple[Bus, ScriptedPort, SimulatedClock]:
    clock = SimulatedClock(5.0)
    port = ScriptedPort(clock, *answers)
    typed: Port = port
    return Bus(typed, clock), port, clock


def status(servo_id: int, data: bytes = b"", error: int = 0) -> bytes:
    return wire.packet(servo_id, error, data)


def state(position: int) -> bytes:
    return position.to_bytes(2, "little") + bytes((0, 0, 0, 0, 120, 30))


def is_state(reading: object) -> bool:
    return isinstance(reading, ServoState)


# One servo


def test_identify_accepts_the_right_model() -> None:
    Line().bus.identify(3, sts.STS3215)


def test_identify_names_the_model_found_and_the_remedy() -> None:
    line = Line()
    with pytest.raises(ServoRefused, match=r"servo 3: is model 777 \(.*sts3215.*\), not 2825 \(sts3250\): correct"):
        line.bus.identify(3, sts.STS3250)
    line.servos.servo(3).memory.put(sts.model_number, 1234)
    with pytest.raises(ServoRefused, match=r"is model 1234 \(unknown\), not 777 \(sts3215\)"):
        line.bus.identify(3, sts.STS3215)


def test_a_silent_servo_is_named_with_its_possible_causes() -> None:
    line = Line()
    line.servos.faults.silence(3)
    uses: list[Callable[[], object]] = [
        lambda: line.bus.identify(3, sts.STS3215),
        lambda: line.bus.read(3, sts.present_position),
        lambda: line.bus.write(3, sts.acceleration, 1),
        lambda: line.bus.torque_on(3),
    ]
    for use in uses:
        with pytest.raises(ServoSilent, match="servo 3: does not respond: check its power") as caught:
            use()
        assert caught.value.servo_id == 3


def test_a_corrupt_reply_is_named() -> None:
    line = Line()
    line.servos.faults.corrupt_next(3)
    with pytest.raises(ServoCorrupt, match="servo 3: sent a corrupt packet"):
        line.bus.read(3, sts.present_position)
    assert line.bus.read(3, sts.present_position) == 2048


@pytest.mark.parametrize("register", [sts.acceleration, sts.goal_position, sts.goal_velocity])
def test_a_written_value_is_read_back(register: Register) -> None:
    line = Line()
    line.bus.write(2, register, 99)  # values above 100 are clamped
    assert line.bus.read(2, register) == line.held(2, register) == 99
    assert line.bus.read(1, register) == 0


def test_a_negative_value_is_written_and_read_back() -> None:
    line = Line()
    line.bus.write(2, sts.goal_position, -300)
    assert line.bus.goal(2) == -300


def test_a_value_that_does_not_fit_is_not_sent() -> None:
    bus, port, _ = scripted()
    with pytest.raises(ValueError, match="torque_limit must be 0 to 1000"):
        bus.write(1, sts.torque_limit, -1)
    with pytest.raises(ValueError, match="goal_position"):
        bus.write_goals({1: ServoGoal(40_000)})
    assert port.sent == b""


def test_more_goals_than_a_packet_holds_are_refused() -> None:
    bus, port, _ = scripted()
    with pytest.raises(ValueError, match="32 goals do not fit into a packet, which holds at most 31"):
        bus.write_goals({i: ServoGoal(0) for i in range(1, 33)})
    assert port.sent == b""


@pytest.mark.parametrize("cycles_before", [0, 3])
def test_a_goal_that_does_not_fit_affects_no_reply(cycles_before: int) -> None:
    """The request is refused before anything is sent. The servos keep their goals, and nothing is counted."""
    line = Line()
    goals = {i: ServoGoal(2000 + i) for i in IDS}
    for _ in range(cycles_before):
        exchange(line.bus, goals, IDS, line.clock.now() + 0.01)
    held = [line.held(i, sts.goal_position) for i in IDS]
    with pytest.raises(ValueError, match="goal_position"):
        exchange(line.bus, goals | {2: ServoGoal(40_000)}, IDS, line.clock.now() + 0.01)
    assert [line.held(i, sts.goal_position) for i in IDS] == held
    readings = exchange(line.bus, goals, IDS, line.clock.now() + 0.01)
    assert all(isinstance(r, ServoState) for r in readings.values())
    assert not any(line.bus.counters.faults().values())


def test_an_alarm_in_a_reply_is_not_an_error() -> None:
    """A servo with an overload alarm must still accept commands, above all the command to release its torque."""
    bus, _, _ = scripted(status(1, b"\x01", error=0x20), b"", status(1, error=0x20))
    assert bus.torque_is_on(1)
    assert bus.torque_off([1]) == []


def test_a_silent_servo_costs_one_wait_without_spinning() -> None:
    bus, port, clock = scripted()
    with pytest.raises(ServoSilent):
        bus.read(1, sts.present_position)
    assert port.reads <= 2
    assert 0.01 < clock.now() - 5.0 < 0.05


def test_the_wait_for_a_truncated_reply_ends_at_the_deadline() -> None:
    bus, port, clock = scripted(status(1, b"\x01\x02")[:-2])
    with pytest.raises(ServoCorrupt):
        bus.read(1, sts.present_position)
    assert port.reads <= 4
    assert clock.now() - 5.0 < 0.05


@pytest.mark.parametrize(
    ("register", "data"),
    [
        (sts.torque_enable, b""),
        (sts.torque_enable, b"\x01\x02"),
        (sts.present_position, b""),
        (sts.present_position, b"\x01"),
        (sts.present_position, b"\x01\x02\x03"),
    ],
)
def test_a_reply_of_a_different_length_is_not_a_value(register: Register, data: bytes) -> None:
    """A late acknowledgment has the right ID and a valid checksum, but does not belong to the request."""
    bus, _, _ = scripted(status(1, data))
    with pytest.raises(ServoCorrupt, match=rf"servo 1: sent {len(data)} bytes? in reply to {register.name}"):
        bus.read(1, register)


@pytest.mark.parametrize("late", [status(3), status(3, b"\x09")])
def test_identify_survives_a_reply_without_a_model_number(late: bytes) -> None:
    bus, _, _ = scripted(late, late)
    with pytest.raises(DriverError, match="servo 3"):
        bus.identify(3, sts.STS3215)


@pytest.mark.parametrize("mode", [1, 2, 3])
def test_a_servo_not_in_position_mode_is_refused_with_the_setting(mode: int) -> None:
    line = Line()
    line.servos.servo(3).memory.put(sts.operating_mode, mode)
    with pytest.raises(ServoRefused, match=r"servo 3: is not in position mode: set operating_mode \(33\) to 0"):
        line.bus.identify(3, sts.STS3215)


def test_a_servo_that_multiplies_its_goals_is_refused_with_the_setting() -> None:
    line = Line()
    for harmless in (0, 1):
        line.servos.servo(3).memory.put(sts.angular_resolution, harmless)
        line.bus.identify(3, sts.STS3215)
    line.servos.servo(3).memory.put(sts.angular_resolution, 2)
    with pytest.raises(ServoRefused, match=r"servo 3: .*goal by 2: set angular_resolution \(30\) to 1"):
        line.bus.identify(3, sts.STS3215)


def test_a_servo_without_acknowledgments_is_refused_with_the_setting() -> None:
    line = Line()
    line.servos.servo(3).memory.put(sts.status_level, 0)
    with pytest.raises(ServoRefused, match=r"does not acknowledge writes: set its status_level \(register 8\) to 1"):
        line.bus.identify(3, sts.STS3215)


def test_a_servo_that_acknowledges_writes_despite_its_setting_is_accepted(monkeypatch: pytest.MonkeyPatch) -> None:
    """A simulator whose control table contains only zeros acknowledges writes although its status level is 0."""
    line = Line()
    line.servos.servo(3).memory.put(sts.status_level, 0)
    line.servos.servo(3).memory.put(sts.acceleration, 7)
    monkeypatch.setattr(StsMemory, "answers", 2)
    line.bus.identify(3, sts.STS3215)
    assert line.held(3, sts.acceleration) == 7


def test_a_different_unit_of_speed_is_logged(caplog: pytest.LogCaptureFixture) -> None:
    line = Line()
    line.bus.identify(3, sts.STS3215)
    assert not caplog.records
    line.servos.servo(3).memory.put(sts.phase, 8)
    line.bus.identify(3, sts.STS3215)
    assert "servo 3: phase (register 18) is 8" in caplog.text
    assert "set phase to 12" in caplog.text


def test_the_persistent_torque_limit_is_the_upper_bound() -> None:
    line = Line()
    line.servos.servo(1).memory.put(sts.max_torque, 500)
    for share, limit in ((1.0, 499), (0.3, 300)):
        line.bus.limit_torque(1, share)
        assert line.held(1, sts.torque_limit) == limit


def test_a_reply_of_another_servo_is_not_accepted() -> None:
    bus, _, _ = scripted(status(2, b"\x07\x07") + status(1, b"\x00\x08"))
    assert bus.read(1, sts.present_position) == 2048


def test_old_input_is_discarded_before_a_request() -> None:
    bus, port, _ = scripted(status(1, b"\x00\x08"))
    port.input = status(1, b"\x01\x01")
    assert bus.read(1, sts.present_position) == 2048


def test_an_interrupt_in_a_read_does_not_block_the_bus() -> None:
    """After Ctrl-C, the servos must still be reachable, so that their torque can be released."""
    line = Line()
    line.bus.torque_on(1)

    def interrupted(size: int, deadline_s: float) -> bytes:
        raise KeyboardInterrupt

    read = line.port.read
    line.port.read = interrupted  # type: ignore[method-assign]
    with pytest.raises(KeyboardInterrupt):
        line.bus.read(1, sts.present_position)
    line.port.read = read  # type: ignore[method-assign]
    assert line.bus.torque_off([1]) == []
    assert line.held(1, sts.torque_enable) == 0


# Groups


def test_all_states_are_read_in_one_exchange() -> None:
    line = Line()
    line.servos.servo(2).memory.put(sts.goal_position, 3000)
    readings = line.bus.read_states(IDS)
    assert list(readings) == list(IDS)
    for reading in readings.values():
        assert isinstance(reading, ServoState)
        assert reading == ServoState(2048, 0, 0.0, pytest.approx(12.0), reading.temperature_c)
        assert 15.0 < reading.temperature_c < 40.0


def test_units_and_signs_of_a_state() -> None:
    data = bytes((0x01, 0x80, 0x64, 0x80, 0xF4, 0x05, 118, 41))  # position -1, velocity -100, load -500, 11.8 V, 41 C
    bus, _, _ = scripted(status(1, data, error=0x24))
    assert bus.read_states([1])[1] == ServoState(
        -1, -100, pytest.approx(0.5), pytest.approx(11.8), 41.0, ("temperature", "overload")
    )


@pytest.mark.parametrize("silent", [(1,), (4,), (7,), (1, 2), (3, 5), (1, 3, 5, 7), (1, 2, 3, 4, 5, 6)])
def test_silent_servos_do_not_hide_the_others(silent: tuple[int, ...]) -> None:
    line = Line()
    for servo_id in silent:
        line.servos.faults.silence(servo_id)
    readings = line.bus.read_states(IDS)
    for servo_id in IDS:
        if servo_id in silent:
            assert readings[servo_id] == ServoFault("silent", f"servo {servo_id} does not respond")
        else:
            assert is_state(readings[servo_id]), servo_id


@pytest.mark.parametrize("silent", IDS)
def test_a_silent_servo_costs_a_few_milliseconds(silent: int) -> None:
    line = Line()
    begin_s = line.clock.now()
    line.bus.read_states(IDS)
    whole_s = line.clock.now() - begin_s
    line.servos.faults.silence(silent)
    begin_s = line.clock.now()
    line.bus.read_states(IDS)
    cost_s = line.clock.now() - begin_s - whole_s
    assert whole_s < 0.0025
    assert cost_s < 0.008


def test_a_dead_bus_costs_the_first_wait_only() -> None:
    line = Line()
    for servo_id in IDS:
        line.servos.faults.silence(servo_id)
    begin_s = line.clock.now()
    assert {r.kind for r in line.bus.read_states(IDS).values() if isinstance(r, ServoFault)} == {"silent"}
    assert line.clock.now() - begin_s == pytest.approx(FIRST_REPLY_S, abs=1e-3)


@pytest.mark.parametrize("corrupt", IDS)
def test_a_corrupt_reply_is_named_and_the_others_are_read(corrupt: int) -> None:
    line = Line()
    line.servos.faults.corrupt_next(corrupt)
    readings = dict(line.bus.read_states(IDS))
    assert readings.pop(corrupt) == ServoFault("corrupt", f"servo {corrupt} replied with a wrong checksum")
    assert all(map(is_state, readings.values()))
    assert all(map(is_state, line.bus.read_states(IDS).values()))


@pytest.mark.parametrize(
    "noise", [b"\x00", b"\xff", b"\xff\xff", b"\xff\xff\x01\x0a\x00\x01", b"\xff\xff\x02\xf0", bytes(range(200))]
)
def test_noise_between_replies_costs_no_reply(noise: bytes) -> None:
    burst = noise.join(status(i, state(1000 + i)) for i in (1, 2, 3))
    bus, _, _ = scripted(noise + burst)
    readings = bus.read_states([1, 2, 3])
    assert [r.position_counts for r in readings.values() if isinstance(r, ServoState)] == [1001, 1002, 1003]


def test_input_before_the_request_is_not_a_reply() -> None:
    bus, port, _ = scripted(status(1, state(2000)))
    port.input = status(1, state(1)) + status(2, state(1))
    first, second = bus.read_states([1, 2]).values()
    assert isinstance(first, ServoState)
    assert first.position_counts == 2000
    assert isinstance(second, ServoFault)


def test_replies_of_servos_without_a_request_are_ignored() -> None:
    bus, _, _ = scripted(status(9, state(1)) + status(1, state(2000)))
    readings = bus.read_states([1])
    assert list(readings) == [1]
    assert is_state(readings[1])


@pytest.mark.parametrize("noise", [b"\x00", b"\xff", status(9)])
def test_a_read_ends_despite_endless_noise(noise: bytes) -> None:
    bus, port, clock = scripted()

    def babble(size: int, deadline_s: float) -> bytes:
        if clock.now() >= deadline_s:
            return b""
        clock.sleep_until(clock.now() + size * 1e-5)
        return (noise * size)[:size]

    port.read = babble  # type: ignore[method-assign]
    assert not any(map(is_state, bus.read_states(IDS).values()))
    assert clock.now() - 5.0 < 0.06
    with pytest.raises(ServoError):
        bus.read(1, sts.goal_position)
    assert clock.now() - 5.0 < 0.12


@pytest.mark.parametrize("baud", [1_000_000, 115_200, 38_400])
def test_replies_of_a_slow_adapter_are_received(baud: int) -> None:
    clock = SimulatedClock()
    servos = VirtualBus.of(BenchPlant(IDS))
    for servo in servos.servos:
        servo.memory.put(sts.baud_rate, sts.BAUD_RATES.index(baud))
    bus = Bus(VirtualPort(servos, clock, baud=baud), clock)
    assert all(map(is_state, bus.read_states(IDS).values()))
    servos.faults.silence(2)
    assert sum(map(is_state, bus.read_states(IDS).values())) == len(IDS) - 1


def test_goals_arrive_with_their_velocity_and_a_fixed_acceleration() -> None:
    line = Line()
    line.bus.write(2, sts.acceleration, 9)
    line.bus.write_goals({1: ServoGoal(2000, 300), 2: ServoGoal(2100), 3: ServoGoal(-5, 1)})
    wanted = {1: (2000, 300), 2: (2100, 0), 3: (-5, 1), 4: (0, 0)}
    for servo_id, (position, velocity) in wanted.items():
        assert line.bus.goal(servo_id) == position
        assert line.held(servo_id, sts.goal_velocity) == velocity
        assert line.held(servo_id, sts.acceleration) == (sts.GOAL_ACCELERATION if servo_id in (1, 2, 3) else 0)


# Torque


def test_torque_is_switched_for_single_servos() -> None:
    line = Line()
    assert not line.bus.torque_is_on(2)
    line.bus.torque_on(2)
    assert line.bus.torque_is_on(2)
    assert not line.bus.torque_is_on(1)
    assert line.bus.torque_off(IDS) == []
    assert not line.bus.torque_is_on(2)


@pytest.mark.parametrize("broken", [(1,), (7,), (1, 4, 7)])
def test_torque_off_tries_every_servo_and_names_those_that_failed(broken: tuple[int, ...]) -> None:
    line = Line()
    for servo_id in IDS:
        line.bus.torque_on(servo_id)
    for servo_id in broken:
        line.servos.faults.silence(servo_id)
    failed = line.bus.torque_off(IDS)
    assert [error.servo_id for error in failed] == list(broken)
    assert [i for i in IDS if line.held(i, sts.torque_enable)] == list(broken)


def test_torque_off_continues_after_a_corrupt_acknowledgment() -> None:
    line = Line()
    for servo_id in IDS:
        line.bus.torque_on(servo_id)
    line.servos.faults.corrupt_next(2)
    assert [error.servo_id for error in line.bus.torque_off(IDS)] in ([], [2])
    assert not any(line.held(i, sts.torque_enable) for i in IDS)


def test_torque_off_is_repeated_and_a_silent_servo_does_not_delay_others() -> None:
    line = Line()
    line.servos.faults.silence(2)
    written_ids: list[int] = []

    def reaches(servo_id: int) -> bool:
        written_ids.append(servo_id)
        return written_ids.count(servo_id) > ATTEMPTS  # loses the broadcast and all attempts except for the last one

    for servo_id in (1, 3):
        line.bus.torque_on(servo_id)
    line.servos.faults.on_instruction.append(reaches)
    assert [error.servo_id for error in line.bus.torque_off((1, 2, 3))] == [2]
    assert not line.held(1, sts.torque_enable) and not line.held(3, sts.torque_enable)
    assert written_ids[: len(IDS) + 3] == [*IDS, 1, 2, 3]


def test_a_limit_without_any_torque_is_refused_with_the_register() -> None:
    line = Line()
    for held, share in ((0, 1.0), (1, 1.0), (1000, 0.0)):
        line.servos.servo(1).memory.put(sts.max_torque, held)
        with pytest.raises(ServoRefused, match=rf"servo 1: .*max_torque \(register 16\) is {held}.*torque_limit"):
            line.bus.limit_torque(1, share)
    assert line.held(1, sts.torque_limit) == 1000


@pytest.mark.parametrize(("share", "value"), [(1.0, 999), (0.5, 500), (0.1234, 123)])
def test_the_torque_limit_is_a_share(share: float, value: int) -> None:
    """The full torque limit is written as 999, so that the limit always differs from that of a servo that was reset."""
    line = Line()
    line.bus.limit_torque(1, share)
    assert line.held(1, sts.torque_limit) == value


# The line


def test_every_call_raises_port_lost_after_the_port_is_lost() -> None:
    line = Line()
    line.port.unplug()
    uses: list[Callable[[], object]] = [
        lambda: line.bus.identify(1, sts.STS3215),
        lambda: line.bus.read(1, sts.goal_position),
        lambda: line.bus.write(1, sts.acceleration, 0),
        lambda: line.bus.read_states(IDS),
        lambda: line.bus.write_goals({1: ServoGoal(1)}),
        lambda: line.bus.torque_on(1),
        lambda: line.bus.torque_off(IDS),
    ]
    for use in uses * 2:
        with pytest.raises(PortLost):
            use()


def test_close_closes_the_port() -> None:
    line = Line()
    assert line.bus.name == "virtual"
    line.bus.close()
    line.bus.close()
    with pytest.raises(PortLost):
        line.port.write(b"")
