"""If servos answer pings but no reads or no group reads, the cause is found, and no factory reset is recommended."""

from pathlib import Path
from typing import Any

import pytest

from commissioning.commissioning_errors import CommissioningError
from commissioning.registers.access import read_register, write_register
from commissioning.registers.mute import answer_reads
from commissioning.scan.find import find_servo
from commissioning.scan.scan import ScanScope, scan
from drivers.servos import ax_mx, sts, x, xl320
from drivers.servos.catalog import series_of
from drivers.servos.register import ServoModel
from tests.commissioning import ailments
from tests.commissioning.lines import ToolLine
from tests.commissioning.patient import Patient
from tests.commissioning.served import run, served
from tests.drivers.plain_slaves import PlainLine, PlainSlaveBus

KEEPS_A_LEVEL = (ax_mx.MX_28, ax_mx.AX_12A, x.XL430_W250, xl320.XL320)


def muted(model: ServoModel) -> ToolLine:
    """Return a line with a servo whose status level allows only replies to pings."""
    line = ToolLine({1: model})
    line.put(1, series_of(model).status_level, 0)
    return line


def test_a_servo_without_group_reads_is_scanned_with_single_reads() -> None:
    line = PlainLine({1: x.XL430_W250, 2: x.XL430_W250}, (1,))
    plain, usual = scan(line.port, line.clock, ScanScope(bauds=[1_000_000])).servos
    assert (plain.model, plain.voltage_v, plain.torque) == ("xl430-w250", 12.0, False)
    (problem,) = plain.problems
    assert problem.kind == "no_group_reads"
    assert "status_return_level, register 68, is 2" in problem.text and "reset" not in problem.text
    assert usual.problems == ()


def test_its_registers_can_be_read_and_written() -> None:
    line = PlainLine({1: x.XL430_W250}, (1,))
    with find_servo(line.port, line.clock, 1) as servo:
        assert read_register(servo, "status_return_level").raw == 2
        assert write_register(servo, "led", 1).after.raw == 1
        assert write_register(servo, "torque_enable", 1, torque=True).after.raw == 1


def test_the_doctor_explains_a_servo_without_group_reads() -> None:
    patient = Patient("robot_arm_dynamixel")
    patient.line.__class__ = PlainSlaveBus
    patient.line.plain = (3,)  # type: ignore[attr-defined]
    (found,) = patient.examine().findings
    assert (found.id, found.severity, found.place.servo_id) == ("no_group_reads", "warning", 3)
    assert "status_return_level (register 68) is 2" in found.cause and found.command is None


def test_the_doctor_advises_to_set_the_status_level_of_a_mute_dynamixel() -> None:
    patient = Patient("robot_arm_dynamixel")
    patient.put(3, x.status_return_level, 0)
    found = patient.examine().findings[0]
    model = patient.robot.joints[2].model.name
    assert (found.id, found.command) == (
        "servo_mute",
        f"servoloop register write --port /dev/ttyACM0 --id 3 status_return_level 2 --model {model}",
    )
    assert "switch its supply off and on" in found.cause and "reset" not in found.cause
    assert answer_reads(patient.open("", 1_000_000), patient.clock, 3, patient.robot.joints[2].model) == 2
    assert patient.examine().findings == ()


def test_no_finding_for_a_mute_servo_advises_a_factory_reset() -> None:
    patient = Patient()
    ailments.mute(patient)
    found = patient.examine().findings[0]
    assert found.id == "servo_mute" and found.command is None
    assert "Switch its supply off and on" in found.cause and "reset" not in found.cause


@pytest.mark.parametrize("model", KEEPS_A_LEVEL, ids=lambda model: model.name)
def test_a_mute_servo_answers_reads_again(model: ServoModel) -> None:
    line = muted(model) if model is not xl320.XL320 else _muted_xl320()
    assert [problem.kind for one in line.scan(bauds=[1_000_000]).servos for problem in one.problems] == ["no_reads"]
    assert answer_reads(line.port, line.clock, 1, model) == 2
    assert [one.problems for one in line.scan(bauds=[1_000_000]).servos] == [()]


def _muted_xl320() -> Any:
    line = PlainLine({1: xl320.XL320}, ())
    line.servos.servo(1).memory.put(xl320.status_return_level, 0)
    line.scan = lambda **options: scan(line.port, line.clock, ScanScope(**options))  # type: ignore[attr-defined]
    return line


def test_a_servo_of_another_model_is_named() -> None:
    line = muted(x.XL430_W250)
    with pytest.raises(CommissioningError, match=r"servo 1 is model 1060 \(xl430-w250\), not xm430-w350 \(1020\)"):
        answer_reads(line.port, line.clock, 1, x.XM430_W350)


@pytest.mark.parametrize("model", [sts.STS3215, ax_mx.MX_28], ids=lambda model: model.name)
def test_a_servo_that_answers_reads_is_not_written(model: ServoModel) -> None:
    line = ToolLine({1: model})
    before = line.servos.servo(1).memory.read(0, 24)
    with pytest.raises(CommissioningError, match=r"servo 1 responds to reads .* nothing was written\. Omit --model"):
        answer_reads(line.port, line.clock, 1, ax_mx.MX_28)
    assert line.servos.servo(1).memory.read(0, 24) == before


def test_a_servo_that_stays_mute_is_reported() -> None:
    patient = Patient()
    ailments.mute(patient)
    with pytest.raises(CommissioningError, match="servo 3 still responds to pings but not to reads"):
        answer_reads(patient.open("", 1_000_000), patient.clock, 3, sts.STS3215)


def test_the_command_sets_the_status_level(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    link = tmp_path / "bus"
    where = ("--port", str(link), "--id", "1", "--baud", "1000000")
    with served(link, {1: x.XL430_W250}) as bus:
        bus.servo(1).memory.put(x.status_return_level, 0)
        write = ("register", "write", *where, "status_return_level", "2", "--model")
        assert run(monkeypatch, *write, "xl430-w250") == 0
        assert capsys.readouterr().out == "servo 1 responds to reads; its status_return_level is 2\n"
        assert run(monkeypatch, *write, "xl430-w250") == 1
        assert "servo 1 responds to reads" in " ".join(capsys.readouterr().err.split())
        assert run(monkeypatch, *write, "xl430") == 1
        assert "--model xl430 is unknown" in " ".join(capsys.readouterr().err.split())
        assert run(monkeypatch, "register", "write", *where, "led", "1", "--model", "xl430-w250") == 1
        assert "only 'status_return_level 2' can be written" in " ".join(capsys.readouterr().err.split())
