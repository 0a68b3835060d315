"""The bus that asks servos one by one, with virtual servos: the contract of every Bus, and the differences."""

import logging
from collections.abc import Callable

import pytest

from drivers.bus.bus import Bus
from drivers.clock import MonotonicClock
from drivers.driver_errors import PortLost, ServoCorrupt, ServoError, ServoRefused, ServoSilent
from drivers.port.line import GAP_S
from drivers.protocol import v1 as wire
from drivers.servos import ax_mx as dxl
from drivers.servos import scs, sts
from drivers.servos import x as x_series
from drivers.servos.catalog import MODELS, series_of
from drivers.servos.register import ServoModel
from drivers.types import ServoFault, ServoGoal, ServoState
from sim_backend.clock import SimulatedClock
from tests.drivers.cycles import exchange
from tests.drivers.fault_lines import IDS, Kind, Line
from tests.drivers.fault_lines import READ_EACH as KINDS
from tests.drivers.tape import ScriptedPort, Tape

every_kind = pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
ax_and_scs = pytest.mark.parametrize("kind", (KINDS[0], KINDS[2]), ids=lambda kind: kind.name)


def scripted(kind: Kind, *answers: bytes) -> tuple[Bus, ScriptedPort, SimulatedClock]:
    clock = SimulatedClock(5.0)
    port = ScriptedPort(clock, *answers)
    return Bus(port, clock, kind.models), port, clock


# One servo


@every_kind
def test_identify_accepts_the_right_model(kind: Kind) -> None:
    line = Line(kind)
    for servo_id, model in kind.models.items():
        line.bus.identify(servo_id, model)


@pytest.mark.parametrize(
    ("kind", "register", "number", "text"),
    [
        (KINDS[0], scs.model_number, 0x050F, r"is model 1295 \(scs15\), not 1284 \(scs0009\): correct"),
        (
            KINDS[0],
            scs.model_number,
            0x0903,
            r"is model 2307 \(sts3215 or sts3215_c001 or sts3215_c044 or sts3215_c046\), not 1284",
        ),
        (KINDS[2], dxl.model_number, 29, r"is model 29 \(mx-28\), not 12 \(ax-12a\)"),
        (KINDS[2], dxl.model_number, 1060, r"is model 1060 \(xl430-w250\), not 12"),
        (KINDS[3], dxl.model_number, 4321, r"is model 4321 \(unknown\), not 29 \(mx-28\)"),
    ],
)
def test_identify_names_the_model_found(kind: Kind, register, number: int, text: str) -> None:  # type: ignore[no-untyped-def]
    line = Line(kind)
    line.servos.servo(3).memory.put(register, number)
    with pytest.raises(ServoRefused, match="servo 3: " + text):
        line.bus.identify(3, kind.model)


@pytest.mark.parametrize(
    ("kind", "limits", "text"),
    [
        (KINDS[0], (0, 0), "servo 3: is in motor mode"),
        (KINDS[2], (0, 0), "servo 3: is in wheel mode: set its angle limits"),
        (KINDS[3], (0, 0), "servo 3: is in wheel mode"),
        (KINDS[3], (4095, 4095), "servo 3: is in multi-turn mode: set its angle limits .* to 0 and 4095"),
    ],
)
def test_a_mode_without_goal_positions_is_refused(kind: Kind, limits: tuple[int, int], text: str) -> None:
    line = Line(kind)
    for register, value in zip((sts.min_position, sts.max_position), limits, strict=True):
        line.servos.servo(3).memory.put(register, value)
    with pytest.raises(ServoRefused, match=text):
        line.bus.identify(3, kind.model)


@pytest.mark.parametrize(
    ("kind", "level", "text"),
    [
        (KINDS[0], 0, r"servo 3: does not acknowledge writes: set its status_level \(register 8\) to 1"),
        (KINDS[2], 1, r"servo 3: does not acknowledge writes: set its status_return_level \(register 16\) to 2"),
        (KINDS[3], 0, r"servo 3: responds to pings but not to reads: set its status_return_level \(register 16\) to 2"),
    ],
)
def test_a_servo_that_does_not_answer_all_requests_is_refused(kind: Kind, level: int, text: str) -> None:
    line = Line(kind)
    line.servos.servo(3).memory.put(series_of(kind.model).status_level, level)
    with pytest.raises(ServoRefused, match=text):
        line.bus.identify(3, kind.model)


@every_kind
def test_a_silent_servo_is_named(kind: Kind) -> None:
    line = Line(kind)
    line.faults.silence(3)
    uses: list[Callable[[], object]] = [
        lambda: line.bus.identify(3, kind.model),
        lambda: line.bus.goal(3),
        lambda: line.bus.torque_on(3),
    ]
    for use in uses:
        with pytest.raises(ServoSilent, match="servo 3: does not respond: check its power"):
            use()


@every_kind
def test_a_corrupt_reply_is_named(kind: Kind) -> None:
    line = Line(kind)
    line.faults.corrupt_next(3)
    with pytest.raises(ServoCorrupt, match="servo 3: sent a corrupt packet"):
        line.bus.read(3, series_of(kind.model).goal_position)
    assert line.bus.goal(3) == line.held(3, series_of(kind.model).goal_position)


@every_kind
def test_a_reply_of_a_different_length_is_not_a_value(kind: Kind) -> None:
    for data in (b"", b"\x01", b"\x01\x02\x03"):
        bus, _, _ = scripted(kind, wire.packet(1, 0, data))
        with pytest.raises(ServoCorrupt, match=rf"sent {len(data)} bytes? in reply to goal_position"):
            bus.read(1, series_of(kind.model).goal_position)


@ax_and_scs
def test_a_frame_with_an_impossibly_small_length_is_corrupt(kind: Kind) -> None:
    bus, _, _ = scripted(kind, b"\xff\xff\x01\x00\x00\xfe\x00\x00")
    with pytest.raises(ServoError, match="servo 1"):
        bus.goal(1)


def test_an_alarm_is_not_an_error_but_a_refusal_is() -> None:
    bus, _, _ = scripted(KINDS[2], wire.packet(1, 0x20, b"\x01"), b"", wire.packet(1, 0x20, b""))
    assert bus.torque_is_on(1)
    assert bus.torque_off([1]) == []
    bus, _, _ = scripted(KINDS[2], wire.packet(1, 0x08, b""))
    with pytest.raises(ServoRefused, match=r"servo 1: rejected the instruction \(range error\)"):
        bus.write(1, dxl.led, 9)


# Groups


@every_kind
def test_states_have_units_and_signs(kind: Kind) -> None:
    order = kind.order
    speed = 0x8064 if order == "big" else 0x0464
    raw = (700).to_bytes(2, order) + speed.to_bytes(2, order) + (0x05F4).to_bytes(2, order) + bytes((118, 41))
    bus, _, _ = scripted(Kind(kind.name, {1: kind.model}), wire.packet(1, 0x24, raw))
    unit = 1.0 if order == "big" else dxl.speed_unit_counts_s(kind.model)
    full = 1000.0 if order == "big" else 1023.0
    assert bus.read_states([1])[1] == ServoState(
        700, round(-100 * unit), pytest.approx(-500 / full), pytest.approx(11.8), 41.0, ("temperature", "overload")
    )


@every_kind
@pytest.mark.parametrize("silent", [(1,), (4,), (7,), (1, 2), (1, 3, 5, 7), (1, 2, 3, 4, 5, 6)])
@pytest.mark.parametrize("hurried", [True, False])
def test_silent_servos_do_not_hide_the_others(kind: Kind, silent: tuple[int, ...], hurried: bool) -> None:
    line = Line(kind)
    for servo_id in silent:
        line.faults.silence(servo_id)
    readings = line.bus.read_states(IDS, line.clock.now() + 0.03 if hurried else None)
    assert list(readings) == list(IDS)
    for servo_id in IDS:
        if servo_id in silent:
            assert readings[servo_id] == ServoFault("silent", f"servo {servo_id} does not respond")
        else:
            assert isinstance(readings[servo_id], ServoState), servo_id


@every_kind
def test_a_corrupt_reply_in_a_group_is_named(kind: Kind) -> None:
    line = Line(kind)
    line.faults.corrupt_next(4)
    readings = dict(line.bus.read_states(IDS))
    assert readings.pop(4) == ServoFault("corrupt", "servo 4 replied with a wrong checksum")
    assert all(isinstance(reading, ServoState) for reading in readings.values())


@every_kind
def test_a_silent_bus_costs_one_long_wait(kind: Kind) -> None:
    line = Line(kind)
    for servo_id in IDS:
        line.faults.silence(servo_id)
    begin_s = line.clock.now()
    line.bus.read_states(IDS)
    assert line.clock.now() - begin_s < 0.04


@every_kind
@pytest.mark.parametrize("noise", [b"\x00", b"\xff", wire.packet(9, 0, b"")])
def test_a_read_ends_despite_endless_noise(kind: Kind, noise: bytes) -> None:
    bus, port, clock = scripted(kind)

    def babble(size: int, deadline_s: float) -> bytes:
        if clock.now() >= deadline_s:
            return b""
        clock.sleep_until(clock.now() + size * 1e-5)
        return (noise * size)[:size]

    port.read = babble  # type: ignore[method-assign]
    readings = bus.read_states(IDS, clock.now() + 0.05)
    assert not any(isinstance(reading, ServoState) for reading in readings.values())
    assert clock.now() - 5.0 < 0.051
    with pytest.raises(ServoError):
        bus.read(1, series_of(kind.model).goal_position)
    assert clock.now() - 5.0 < 0.11


@every_kind
def test_goals_arrive_with_their_velocity(kind: Kind) -> None:
    line = Line(kind)
    line.bus.write_goals({1: ServoGoal(600, 300), 2: ServoGoal(700)})
    assert (line.bus.goal(1), line.bus.goal(2)) == (600, 700)
    assert line.held(2, sts.goal_velocity) == 0
    # The result is never slower than requested, and less than one unit faster.
    unit = 1.0 if kind.order == "big" else dxl.speed_unit_counts_s(kind.models[1])
    assert 300 <= line.held(1, sts.goal_velocity) + 0.5 < 301 + unit
    line.bus.write_goals({1: ServoGoal(600, 10**6)})
    assert line.held(1, sts.goal_velocity) > 1000


@every_kind
def test_a_goal_outside_the_servos_range_is_not_sent(kind: Kind) -> None:
    bus, port, _ = scripted(kind)
    for position in (-1, 4096):
        with pytest.raises(ValueError, match="goal_position must be 0 to"):
            bus.write_goals({1: ServoGoal(position)})
    assert port.sent == b""


@every_kind
@pytest.mark.parametrize("velocity", [-1, -5, -(10**6)])
def test_a_goal_with_a_negative_velocity_is_not_sent(kind: Kind, velocity: int) -> None:
    """A small negative velocity must not be rounded to 0 either, because 0 means maximum velocity."""
    bus, port, _ = scripted(kind)
    with pytest.raises(ValueError, match=f"velocity.* not {velocity}: nothing was written"):
        bus.write_goals({1: ServoGoal(500, velocity)})
    assert port.sent == b""


@every_kind
def test_the_exchange_size_is_the_number_of_bytes_on_the_wire(kind: Kind) -> None:
    line = Line(kind)
    sent = 0
    write = line.port.write

    def counting(data: bytes) -> None:
        nonlocal sent
        sent += len(data)
        write(data)

    line.port.write = counting  # type: ignore[method-assign]
    goals = {i: ServoGoal(600) for i in IDS}
    readings = exchange(line.bus, goals, IDS, line.clock.now() + 0.02)
    assert all(isinstance(reading, ServoState) for reading in readings.values())
    assert line.bus.exchange_size(goals, IDS) == sent + 14 * len(IDS)
    assert [line.bus.goal(i) for i in IDS] == [600] * len(IDS)


# Torque


@every_kind
def test_torque_is_switched_for_single_servos(kind: Kind) -> None:
    line = Line(kind)
    line.bus.torque_on(2)
    assert line.bus.torque_is_on(2) and not line.bus.torque_is_on(1)
    line.faults.silence(7)
    assert [error.servo_id for error in line.bus.torque_off(IDS)] == [7]
    assert not line.bus.torque_is_on(2)


def test_an_scs_without_a_torque_limit_names_the_remedy() -> None:
    line = Line(KINDS[0])
    line.bus.limit_torque(1, 1.0)
    with pytest.raises(
        ServoRefused, match=r"write 400 to max_torque \(register 16, EEPROM\) and set torque_limit: 1\.0"
    ):
        line.bus.limit_torque(1, 0.4)
    assert line.held(1, scs.lock) == 1


def test_the_torque_limit_of_a_dynamixel_stays_below_the_persistent_limit() -> None:
    line = Line(KINDS[2])
    line.bus.limit_torque(1, 0.5)
    assert line.held(1, dxl.torque_limit) == 512
    line.bus.write(1, dxl.max_torque, 300)
    line.bus.limit_torque(1, 1.0)
    assert line.held(1, dxl.torque_limit) == 299  # one less than the limit of a servo that was reset


def test_torque_states_are_returned_as_far_as_time_allows() -> None:
    line = Line(KINDS[2])
    for servo_id in IDS:
        line.bus.limit_torque(servo_id, 0.5)
        line.bus.torque_on(servo_id)
    begin_s = line.clock.now()
    assert line.bus.torque_states(IDS, begin_s + 1.0) == dict.fromkeys(IDS, True)
    half_s = 0.5 * (line.clock.now() - begin_s)
    known = line.bus.torque_states(IDS, line.clock.now() + half_s + GAP_S)
    assert 0 < len(known) < len(IDS) and tuple(known) == IDS[: len(known)]


# The line


@every_kind
def test_every_call_raises_port_lost_after_the_port_is_lost(kind: Kind) -> None:
    line = Line(kind)
    line.port.unplug()
    uses: list[Callable[[], object]] = [
        lambda: line.bus.identify(1, kind.model),
        lambda: line.bus.goal(1),
        lambda: line.bus.read_states(IDS),
        lambda: line.bus.read_states(IDS, line.clock.now() + 0.01),
        lambda: line.bus.write_goals({1: ServoGoal(1)}),
        lambda: line.bus.torque_on(1),
        lambda: line.bus.torque_off(IDS),
    ]
    for use in uses * 2:
        with pytest.raises(PortLost):
            use()


@every_kind
def test_no_servo_answers_at_a_different_baud_rate(kind: Kind) -> None:
    line = Line(kind)
    with line.bus.at_baud(500_000) as bus, pytest.raises(ServoSilent):
        bus.goal(1)
    assert isinstance(line.bus.read_states(IDS)[1], ServoState)


def test_the_longer_cycle_is_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    line = Line(KINDS[0])
    line.cycle()
    with line.bus.at_baud(500_000):
        pass
    (message,) = caplog.messages
    assert "do not support a group read" in message and "the 7 servos are read one by one" in message
    assert "1.54 ms of every cycle at 1000000 baud" in message
    caplog.clear()
    Line(KINDS[3])
    assert caplog.messages == []


# Which bus


@pytest.mark.parametrize(
    ("models", "bus"),
    [
        ((sts.STS3215, sts.STS3032), Bus),
        ((scs.SCS15, scs.SCS0009), Bus),
        ((dxl.AX_12A, dxl.MX_28), Bus),
        ((x_series.XL430_W250,), Bus),
    ],
)
def test_the_bus_fits_the_servos(models: tuple[ServoModel, ...], bus: type[Bus]) -> None:
    assert type(Bus(Tape(), MonotonicClock(), dict(enumerate(models, 1)))) is bus


def test_servos_with_different_protocols_cannot_share_a_bus() -> None:
    with pytest.raises(
        ValueError, match=r"tape: servos with different protocols cannot share a bus: Feetech STS: 1 \(sts3215\); "
    ) as e:
        Bus(Tape(), MonotonicClock(), {1: sts.STS3215, 2: scs.SCS0009, 3: dxl.MX_28})
    assert "Feetech SCS: 2 (scs0009); Dynamixel protocol 1.0: 3 (mx-28)" in str(e.value)


def test_every_model_has_a_name_a_make_and_a_protocol() -> None:
    assert all(model.name == name for name, model in MODELS.items())
    assert {series_of(model).make for model in MODELS.values()} == {"feetech", "dynamixel"}
    assert len({series_of(model).protocol.name for model in MODELS.values()}) == 4
    assert series_of(MODELS["ax-12a"]).make == "dynamixel" and series_of(MODELS["scs15"]).make == "feetech"


@every_kind
def test_an_unknown_servo_is_assumed_to_be_of_the_first_series(kind: Kind) -> None:
    line = Line(kind)
    bus = Bus(line.port, line.clock, {1: line.kind.models[1]})
    readings = bus.read_states((1, 2), line.clock.now() + 0.02)
    assert isinstance(readings[1], ServoState) and isinstance(readings[2], ServoState)
