"""A scan finds every servo at every baud rate, reports problems, and changes nothing."""

import random
from functools import reduce
from operator import and_
from typing import Any

import pytest

from commissioning.registers.tables import rates_of
from commissioning.scan.examine import ScannedServo
from commissioning.scan.identify import identity_of
from commissioning.scan.scan import ScanReport, ScanScope, scan
from commissioning.scan.steps import steps
from commissioning.scan.wire import Wire, _v1_replies
from drivers.driver_errors import PortError, PortLost
from drivers.protocol import v1, v2
from drivers.servos import ax_mx, scs, sts, x
from drivers.servos.catalog import MODELS, series_of
from drivers.servos.register import ServoModel
from sim_backend.buses.port import VirtualPort
from sim_backend.faults import Disturbance
from sim_backend.line.line import DelayedReply
from tests.commissioning.lines import ToolLine
from tests.drivers.ports import EchoingPort, WatchedPort

ONE_OF_EACH = (sts.STS3215, scs.SCS0009, ax_mx.AX_12A, ax_mx.MX_28, x.XL430_W250, x.XM430_W350)
every_make = pytest.mark.parametrize("model", ONE_OF_EACH, ids=lambda model: model.name)
READS_AND_PINGS = {1, 2, 0x82, 0x92, 0x8A}

OFF_THE_FORMULA = {
    model: {115_200, 57_600, 19_200, 9_600} if series_of(model).name.endswith("1.0") else set() for model in ONE_OF_EACH
}
"""Exact baud rates of virtual protocol 1.0 servos, up to 2 % off the nominal rates."""


def series_baud(model: ServoModel) -> Any:
    return next(register for register in series_of(model).registers if register.name == "baud_rate")


def kinds(report: ScanReport) -> dict[int, list[str]]:
    return {one.servo_id: [problem.kind for problem in one.problems] for one in report.servos}


def only(report: ScanReport) -> ScannedServo:
    (servo,) = report.servos
    return servo


def instruction(packet: bytes) -> int:
    return packet[7] if packet.startswith(v2.HEADER) else packet[4]


@every_make
def test_a_healthy_bus_has_no_problems(model: ServoModel) -> None:
    line = ToolLine(dict.fromkeys((1, 5, 30), model))
    report = line.scan()
    assert kinds(report) == {1: [], 5: [], 30: []}
    for one in report.servos:
        assert (one.model, one.model_number, one.baud) == (model.name, model.number, 1_000_000)
        assert one.make == series_of(model).make
        assert one.voltage_v == pytest.approx(model.rated_voltage_v, abs=0.3)
        assert one.temperature_c is not None and 15 < one.temperature_c < 50
        assert (one.torque, one.operating_mode, one.alarms) == (False, "position", ())
    assert (report.absent, report.noise, report.refused_bauds) == ((), {}, ())
    assert line.port.baud == 1_000_000


@every_make
def test_a_scan_sends_pings_and_reads_and_nothing_else(model: ServoModel) -> None:
    line = ToolLine(dict.fromkeys((1, 5), model))
    line.scan()
    assert {instruction(packet) for packet in line.sent} <= READS_AND_PINGS


def test_scanning_an_empty_bus_takes_at_most_half_a_minute() -> None:
    line = ToolLine({1: sts.STS3215})
    line.servos.faults.silence(1)
    began_s = line.clock.now()
    report = line.scan()
    assert (report.servos, report.noise) == ((), {})
    assert line.clock.now() - began_s < 35.0


def test_a_usual_bus_is_found_within_a_second() -> None:
    line = ToolLine(dict.fromkeys(range(1, 8), sts.STS3215))
    began_s, seen = line.clock.now(), []

    def progress(number: int, count: int, text: str, found: Any) -> None:
        seen.append((line.clock.now() - began_s, number, count, len(found)))

    line.scan(progress=progress)
    assert next(time_s for time_s, _, _, found in seen if found == 7) < 1.5
    assert seen[-1][0] < 5.0
    assert [number for _, number, _, _ in seen] == list(range(seen[0][2] + 1))


@pytest.mark.parametrize("baud", sts.BAUD_RATES)
def test_feetech_servos_are_found_at_any_rate(baud: int) -> None:
    line = ToolLine({1: sts.STS3215, 2: sts.STS3250})
    for servo_id in (1, 2):
        line.put(servo_id, sts.baud_rate, sts.BAUD_RATES.index(baud))
    report = line.scan()
    assert [(one.servo_id, one.model, one.baud) for one in report.servos] == [
        (1, "sts3215", baud),
        (2, "sts3250", baud),
    ]
    assert kinds(report) == {1: [], 2: []}


@pytest.mark.parametrize("baud", x.BAUD_RATES)
def test_dynamixels_are_found_at_any_rate(baud: int) -> None:
    line = ToolLine({1: x.XL330_M288})
    line.put(1, x.baud_rate, x.BAUD_RATES.index(baud))
    servo = only(line.scan())
    assert (servo.model, servo.baud, servo.protocol) == ("xl330-m288", baud, "Dynamixel protocol 2.0")


@pytest.mark.parametrize(("value", "baud"), [(1, 1_000_000), (4, 400_000), (9, 200_000), (250, 2_250_000)])
def test_mx_servos_are_found_at_their_special_rates(value: int, baud: int) -> None:
    line = ToolLine({3: ax_mx.MX_28})
    line.put(3, ax_mx.baud_rate, value)
    assert (only(line.scan()).model, only(line.scan()).baud) == ("mx-28", baud)


@pytest.mark.parametrize("seed", range(50))
def test_random_healthy_buses_have_no_problems(seed: int) -> None:
    chance = random.Random(seed)
    model = chance.choice(ONE_OF_EACH)
    rates = {value: rate for value, rate in rates_of(model).items() if rate not in OFF_THE_FORMULA[model]}
    ids = chance.sample(range(253), chance.randint(1, 8))
    line = ToolLine(dict.fromkeys(ids, model))
    value = chance.choice(list(rates))
    for servo_id in ids:
        line.put(servo_id, series_baud(model), value)
    report = line.scan()
    assert kinds(report) == {servo_id: [] for servo_id in sorted(ids)}
    assert {one.baud for one in report.servos} == {rates[value]}
    assert (report.absent, report.noise) == ((), {})


# What is wrong


def test_a_silent_requested_servo_is_absent() -> None:
    line = ToolLine(dict.fromkeys((1, 2, 3), sts.STS3215))
    line.servos.faults.silence(2)
    report = line.scan(servo_ids=[1, 2, 3])
    assert (report.absent, kinds(report)) == ((2,), {1: [], 3: []})


def test_a_servo_at_another_rate_is_not_reported_as_absent() -> None:
    line = ToolLine(dict.fromkeys((1, 2, 3, 4), sts.STS3215))
    line.put(3, sts.baud_rate, sts.BAUD_RATES.index(115_200))
    line.servos.faults.silence(4)
    for options in ({}, {"servo_ids": [1, 2, 3, 4]}):
        report = line.scan(**options)
        assert kinds(report) == {1: [], 2: [], 3: ["other_rate"]}
        assert report.absent == ((4,) if options else ())
        (problem,) = report.servos[2].problems
        assert "responds at 115200 baud" in problem.text and "servoloop set-baud 3 1000000 --port" in problem.text


@pytest.mark.parametrize("count", [2, 3, 6])
@pytest.mark.parametrize("seed", range(4))
@every_make
def test_duplicate_ids_are_detected(model: ServoModel, seed: int, count: int) -> None:
    report = ToolLine.twins(model, count=count, seed=seed).scan(bauds=[1_000_000])
    assert kinds(report) == {1: [], 2: ["collision"]} and not report.complete
    assert "probably two servos have ID 2" in report.servos[1].problems[0].text


def test_duplicate_ids_at_different_rates_are_found() -> None:
    line = ToolLine({1: sts.STS3215, 2: sts.STS3215, 3: sts.STS3215})
    line.put(3, sts.baud_rate, 4)
    line.put(3, sts.servo_id, 2)
    report = line.scan()
    assert not report.complete
    found = [(one.servo_id, one.baud, [p.kind for p in one.problems]) for one in report.servos]
    assert found == [(1, 1_000_000, []), (2, 1_000_000, []), (2, 115_200, ["other_rate"])]


def test_a_voltage_alarm_is_reported_with_the_limits() -> None:
    line = ToolLine({1: sts.STS3215, 2: sts.STS3215})
    line.put(2, sts.max_voltage, 80)
    line.clock.sleep_until(line.clock.now() + 1.0)
    report = line.scan()
    assert kinds(report) == {1: [], 2: ["alarmed"]}
    (problem,) = report.servos[1].problems
    assert "it reports voltage: its supply voltage is 12.0 V, and its limits are 4.0 to 8.0 V" in problem.text
    assert report.servos[1].alarms == ("voltage",)


def test_a_dynamixel_alarm_is_named() -> None:
    line = ToolLine({1: x.XL430_W250})
    line.put(1, x.max_voltage_limit, 80)
    line.servos.servo(1).firmware.load_settings()
    line.clock.sleep_until(line.clock.now() + 1.0)
    servo = only(line.scan())
    assert (servo.alarms, [problem.kind for problem in servo.problems]) == (("voltage",), ["alarmed"])


MODES = [
    (sts.STS3215, {sts.operating_mode: 1}, "velocity"),
    (sts.STS3215, {sts.operating_mode: 3}, "step"),
    (scs.SCS0009, {scs.min_position: 0, scs.max_position: 0}, "motor"),
    (ax_mx.AX_12A, {ax_mx.cw_angle_limit: 0, ax_mx.ccw_angle_limit: 0}, "wheel"),
    (ax_mx.MX_28, {ax_mx.cw_angle_limit: 4095, ax_mx.ccw_angle_limit: 4095}, "multi-turn"),
    (x.XL430_W250, {x.operating_mode: 1}, "velocity"),
    (x.XM430_W350, {x.operating_mode: 0}, "current"),
]


@pytest.mark.parametrize(("model", "settings", "mode"), MODES, ids=lambda a: a if isinstance(a, str) else "")
def test_a_servo_in_another_mode_is_reported(model: ServoModel, settings: dict[Any, int], mode: str) -> None:
    line = ToolLine({1: model})
    for register, value in settings.items():
        line.put(1, register, value)
    servo = only(line.scan())
    assert (servo.operating_mode, [problem.kind for problem in servo.problems]) == (mode, ["wrong_mode"])


def test_a_servo_in_current_based_position_mode_has_no_problem() -> None:
    line = ToolLine({1: x.XM430_W350})
    line.put(1, x.operating_mode, 5)
    servo = only(line.scan())
    assert (servo.operating_mode, servo.problems) == ("current-based position", ())


@pytest.mark.parametrize(("model", "number"), [(sts.STS3215, sts.model_number), (x.XL430_W250, x.model_number)])
def test_an_unknown_model_number_is_reported(model: ServoModel, number: Any) -> None:
    line = ToolLine({1: model})
    line.put(1, number, 3081)
    servo = only(line.scan())
    assert (servo.model, servo.model_number, servo.voltage_v) == (None, 3081, None)
    assert [problem.kind for problem in servo.problems] == ["unknown_model"]


def test_a_servo_that_answers_only_pings_is_reported() -> None:
    line = ToolLine({1: ax_mx.MX_28})
    line.put(1, ax_mx.status_return_level, 0)
    report = line.scan()
    assert kinds(report) == {1: ["no_reads"]}
    command = f"servoloop register write --port {report.port} --id 1 --model MODEL status_return_level 2"
    assert command in only(report).problems[0].text


def test_torque_is_shown_and_left_on() -> None:
    line = ToolLine({1: sts.STS3215, 2: sts.STS3215})
    line.put(2, sts.torque_enable, 1)
    assert [one.torque for one in line.scan().servos] == [False, True]
    assert line.held(2, sts.torque_enable) == 1


# Bad lines


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("model", [sts.STS3215, scs.SCS0009, x.XL430_W250], ids=lambda model: model.name)
def test_a_bad_bus_neither_hides_nor_invents_servos(model: ServoModel, seed: int) -> None:
    line = ToolLine(dict.fromkeys((1, 2, 3, 4, 5, 6), model))
    line.servos.faults.disturbance = Disturbance(seed, drop=0.05, flip=0.02, noise=0.05, miss=0.03)
    report = line.scan(bauds=[1_000_000])
    assert set(kinds(report)) == {1, 2, 3, 4, 5, 6}
    assert all(one.model == model.name and {p.kind for p in one.problems} <= {"bad_line"} for one in report.servos)


def test_a_very_bad_bus_is_not_reported_as_a_collision() -> None:
    line = ToolLine({1: sts.STS3215})
    line.servos.faults.disturbance = Disturbance(5, drop=0.3, flip=0.3)
    (found,) = kinds(line.scan(bauds=[1_000_000])).values()
    assert found == ["bad_line"]


@pytest.mark.parametrize("hold_ms", [4, 16])
@every_make
def test_a_latency_timer_hides_no_servos(model: ServoModel, hold_ms: int) -> None:
    line = ToolLine(dict.fromkeys((1, 2, 5), model), WatchedPort)
    line.port.hold_s = 1e-3 * hold_ms  # type: ignore[attr-defined]
    report = line.scan(bauds=[1_000_000])
    assert {one.servo_id: one.model for one in report.servos} == dict.fromkeys((1, 2, 5), model.name)
    assert {kind for found in kinds(report).values() for kind in found} <= {"late"}


@pytest.mark.parametrize("hold_ms", [25, 40, 60, 100, 200])
@every_make
def test_delayed_replies_are_distinguished_from_a_bad_bus(model: ServoModel, hold_ms: int) -> None:
    line = ToolLine(dict.fromkeys((1, 2, 5), model), WatchedPort)
    line.port.hold_s = 1e-3 * hold_ms  # type: ignore[attr-defined]
    assert kinds(line.scan(bauds=[1_000_000])) == {1: ["late"], 2: ["late"], 5: ["late"]}


@every_make
def test_an_echo_is_not_taken_for_a_servo(model: ServoModel) -> None:
    line = ToolLine(dict.fromkeys((1, 7), model), EchoingPort)
    assert kinds(line.scan()) == {1: [], 7: []}


@pytest.mark.parametrize("packets", [v1, v2])
def test_an_echoed_ping_is_not_a_reply(packets: Any) -> None:
    line = ToolLine({1: sts.STS3215} if packets is v1 else {1: x.XL430_W250}, EchoingPort)
    wire = Wire(line.port, line.clock, packets)
    wire.learn_echo()
    assert [wire.ping(servo_id).whole for servo_id in (0, 1, 2)] == [set(), {1}, set()]
    assert not wire.ping(2).anything


def test_a_voltage_alarm_is_distinguished_from_an_echo() -> None:
    """The echo and the reply are identical: FF FF id 02 01 checksum."""
    line = ToolLine({1: sts.STS3215, 2: sts.STS3215}, EchoingPort)
    line.put(2, sts.max_voltage, 80)
    line.clock.sleep_until(line.clock.now() + 1.0)
    for options in ({}, {"servo_ids": [1, 2, 3]}):
        assert kinds(line.scan(**options)) == {1: [], 2: ["alarmed"]}


def test_a_servo_of_the_wrong_model_is_reported() -> None:
    line = ToolLine({1: sts.STS3215, 2: sts.STS3250, 9: sts.STS3215})
    wanted = {1: MODELS["sts3215_c001"], 2: sts.STS3215, 3: sts.STS3215}
    report = line.scan(models=wanted, bauds=[1_000_000])
    assert (kinds(report), report.absent) == ({1: [], 2: ["wrong_model"]}, (3,))
    assert not report.complete
    (problem,) = report.servos[1].problems
    assert "its model is sts3250 (number 2825), but servo 2 of the arm must be an sts3215 (777)" in problem.text


def test_an_unsupported_rate_is_reported_and_the_scan_continues() -> None:
    line = ToolLine({1: sts.STS3215})
    line.put(1, sts.baud_rate, sts.BAUD_RATES.index(38_400))
    set_baud = line.port.set_baud

    def only_slow(baud: int) -> None:
        if baud > 500_000:
            raise PortError(f"no {baud}")
        set_baud(baud)

    line.port.set_baud = only_slow  # type: ignore[method-assign]
    line.port._baud = 500_000
    report = line.scan()
    assert only(report).baud == 38_400
    assert 1_000_000 in report.refused_bauds


def test_a_lost_port_ends_the_scan() -> None:
    line = ToolLine({1: sts.STS3215})

    def progress(number: int, count: int, text: str, found: Any) -> None:
        if number == 3:
            line.port.unplug()

    with pytest.raises(PortLost):
        line.scan(progress=progress)


class AllAtOncePort(VirtualPort):
    """A port on which all servos answer a broadcast ping of protocol 1.0 at the same time."""

    def write(self, data: bytes) -> None:
        before = len(self._coming)
        super().write(data)
        if data[2] == v1.BROADCAST_ID and len(self._coming) > before:
            replies = [self._coming.pop() for _ in range(len(self._coming) - before)]
            mixed = bytes(reduce(and_, column) for column in zip(*(reply.data for reply in replies), strict=True))
            self._coming.append(DelayedReply(replies[-1].due_s, mixed))


@pytest.mark.parametrize("ids", [(5, 66), (130, 211, 252)])
def test_colliding_broadcast_replies_are_resolved_by_single_pings(ids: tuple[int, ...]) -> None:
    line = ToolLine(dict.fromkeys(ids, ax_mx.AX_12A), AllAtOncePort)
    report = line.scan(bauds=[1_000_000])
    assert kinds(report) == {servo_id: [] for servo_id in ids}


# Makes


def test_the_other_protocol_is_skipped_after_a_reply() -> None:
    line = ToolLine({1: sts.STS3215})
    assert line.scan().skipped == ("Dynamixel protocol 2.0",)
    assert not any(packet.startswith(v2.HEADER) for packet in line.sent)
    assert line.scan(makes=["feetech", "dynamixel"]).skipped == ()
    assert any(packet.startswith(v2.HEADER) for packet in line.sent)


def test_the_steps_contain_every_rate_once() -> None:
    everything = steps()
    assert len(set(everything)) == len(everything)
    assert {step.baud for step in everything if step.packets is v2} == set(x.BAUD_RATES)
    assert {step.baud for step in steps(["feetech"])} == set(sts.BAUD_RATES)
    assert (everything[0].packets, everything[0].baud) == (v1, 1_000_000)
    assert {(step.packets, step.baud) for step in steps(bauds=[250_000])} == {(v1, 250_000), (v2, 250_000)}


# Bytes


@pytest.mark.parametrize("servo_id", [1, 3, 9, 250])
@pytest.mark.parametrize("model", [m for m in MODELS.values() if series_of(m).protocol.packets is v1], ids=str)
def test_the_first_registers_identify_make_and_model(model: ServoModel, servo_id: int) -> None:
    series = series_of(model)
    head = bytearray(7)
    at = series.model_number.address
    head[at : at + 2] = model.number.to_bytes(2, series.protocol.byte_order)
    head[series.servo_id.address] = servo_id
    identity = identity_of(bytes(head), servo_id)
    assert (identity.series, identity.number) == (series, model.number)


def test_replies_are_found_between_noise() -> None:
    good = v1.packet(4, 0, b"")
    broken = v1.packet(7, 0, b"")[:-1] + b"\x00"
    heard = _v1_replies(b"\x12\xff" + good + broken + b"\xff\xff\x03")
    assert (heard.whole, heard.broken) == (frozenset({4}), frozenset({7}))
    assert _v1_replies(b"").anything is False


def test_the_scan_of_a_port_is_one_function() -> None:
    line = ToolLine({1: sts.STS3215})
    assert only(scan(line.port, line.clock, ScanScope([1_000_000], [1]))).servo_id == 1
