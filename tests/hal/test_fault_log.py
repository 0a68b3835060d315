"""Tests that the same fault of several servos in one cycle is logged as one line."""

import logging

import pytest

from hal.servos.fault_log import FaultLog
from hal.servos.servo_faults import RESET_S
from tests.hal.bench import IDS, PERIOD_S, Bench


@pytest.fixture
def log_lines(caplog: pytest.LogCaptureFixture) -> pytest.LogCaptureFixture:
    caplog.set_level("INFO")
    return caplog


@pytest.mark.parametrize(
    ("what", "of_two"),
    [
        ("does not respond", "do not respond"),
        ("replied with a wrong checksum", "replied with a wrong checksum"),
        (
            "has lost its torque (power dip?): reboot it, then activate again",
            "have lost their torque (power dip?): reboot it, then activate again",
        ),
    ],
)
def test_messages_about_one_servo_and_two_servos(what: str, of_two: str, log_lines: pytest.LogCaptureFixture) -> None:
    log = FaultLog()
    log.note(logging.ERROR, "elbow", 2, f"elbow: servo 2 {what}")
    log.flush()
    for label, servo_id in (("elbow", 2), ("finger (bus hand)", 7)):
        log.note(logging.ERROR, label, servo_id, f"{label}: servo {servo_id} {what}")
    log.flush()
    log.flush()
    assert log_lines.messages == [f"elbow: servo 2 {what}", f"elbow (servo 2), finger (bus hand) (servo 7) {of_two}"]


@pytest.mark.parametrize(
    ("first", "second", "both"),
    [
        (
            "low supply: {} has 5.1 V, but an sts3215_c001 is rated for 7.4 V (4.4 to 8.9 V): it is weaker",
            "low supply: {} has 4.9 V, but an sts3215_c001 is rated for 7.4 V (4.4 to 8.9 V): it is weaker",
            "low supply: {} have 4.9 to 5.1 V, but an sts3215_c001 is rated for 7.4 V (4.4 to 8.9 V): it is weaker",
        ),
        (
            "{} reports 5 counts, -0.2 from the previous reading. No joint moves that fast",
            "{} reports 900 counts, +0.75 from the previous reading. No joint moves that fast",
            "{} report 5 to 900 counts, -0.2 to +0.75 from the previous reading. No joint moves that fast",
        ),
        (
            "{} has pressed with its torque limit of 50% without motion and holds with 18%: it is jammed",
            "{} has pressed with its torque limit of 40% without motion and holds with 14%: it is jammed",
            "{} have pressed with their torque limit of 40 to 50% without motion and hold with 14 to 18%: it is jammed",
        ),
    ],
)
def test_messages_that_differ_in_numbers_are_one_event(
    first: str, second: str, both: str, log_lines: pytest.LogCaptureFixture
) -> None:
    log = FaultLog()
    log.note(logging.WARNING, "elbow", 2, first.format("elbow: servo 2"))
    log.flush()
    log.note(logging.WARNING, "elbow", 2, first.format("elbow: servo 2"))
    log.note(logging.WARNING, "finger", 7, second.format("finger: servo 7"))
    log.flush()
    assert log_lines.messages == [first.format("elbow: servo 2"), both.format("elbow (servo 2), finger (servo 7)")]


def test_servos_of_two_models_are_two_events(log_lines: pytest.LogCaptureFixture) -> None:
    log = FaultLog()
    for label, servo_id, model in (("elbow", 2, "sts3215_c001"), ("finger", 7, "sts3215_c044")):
        log.note(logging.WARNING, label, servo_id, f"{label}: servo {servo_id} is an {model}, and has 5.1 V")
    log.flush()
    assert len(log_lines.messages) == 2


def test_a_bus_that_misses_one_cycle_is_logged_twice(log_lines: pytest.LogCaptureFixture) -> None:
    bench = Bench().active()
    bench.wait()
    log_lines.clear()
    for servo_id in IDS:
        bench.servos.faults.silence(servo_id)
    assert len(bench.wait().faults) == 3
    for servo_id in IDS:
        bench.servos.faults.restore(servo_id)
    assert bench.wait().faults == {}
    begin, end = log_lines.messages
    assert begin.startswith("no servo responds on virtual: ")
    assert end == "shoulder (servo 1), elbow (servo 2), finger (servo 7) respond again"


def test_a_bus_whose_replies_are_all_late_is_not_called_silent() -> None:
    bench = Bench().active()
    bench.wait()
    bench.servos.faults.on_arrival.append(lambda servo_id: 1.2 * PERIOD_S)
    kinds, texts = set(), set()
    for _ in range(6):
        for fault in bench.wait().faults.values():
            kinds.add(fault.kind)
            texts.add(fault.text)
    assert kinds == {"silent", "late"}
    late, silent = sorted(texts)
    assert late == "all servos on virtual respond too late: check the adapter and the load of this computer"
    assert silent.startswith("no servo responds on virtual: ")


def test_servos_after_a_cut_cable_are_one_event(log_lines: pytest.LogCaptureFixture) -> None:
    bench = Bench().active()
    bench.wait()
    log_lines.clear()
    for servo_id in IDS[1:]:
        bench.servos.faults.silence(servo_id)
    assert len(bench.wait().faults) == 2
    for servo_id in IDS[1:]:
        bench.servos.faults.restore(servo_id)
    assert bench.wait().faults == {}
    assert log_lines.messages == [
        "elbow (servo 2), finger (servo 7) do not respond",
        "elbow (servo 2), finger (servo 7) respond again",
    ]


def test_servos_that_answer_again_without_torque_are_one_event(log_lines: pytest.LogCaptureFixture) -> None:
    bench = Bench().active()
    bench.wait()
    log_lines.clear()
    for servo_id in IDS:
        bench.servos.faults.silence(servo_id)
    for _ in range(round(2 * RESET_S / PERIOD_S)):
        bench.wait()
    for servo_id in IDS:
        bench.servos.servo(servo_id).power_cycle()
        bench.servos.faults.restore(servo_id)
    for _ in range(20):
        bench.wait()
    _, limp = log_lines.messages
    assert limp == (
        "shoulder (servo 1), elbow (servo 2), finger (servo 7) returned with their torque disabled (power dip?): "
        "activate again"
    )
    bench.hardware.reactivate()
    assert log_lines.messages[2:] == [
        "shoulder, elbow, finger: torque is enabled again, and the joints hold their positions"
    ]
