"""Tables are not truncated in narrow terminals, and all texts are printed as they are."""

from collections import Counter
from io import StringIO

import pytest
from rich.console import Console
from rich.table import Table

from commissioning.calibrate.by_hand import CalibrationTask
from commissioning.doctor.report import BusFigures, DoctorReport, ServoFigures
from commissioning.scan.examine import ScannedServo
from commissioning.scan.scan import ScanReport
from servoloop.commands import scan
from servoloop.commands.doctor import print_report
from servoloop.commands.output.calibrate_terminal import Terminal
from servoloop.commands.registers import tables
from servoloop.commands.shared.console import text_console
from servoloop.demo.jobs import Live
from servoloop.manual.live_table import LiveTable
from servoloop.stack.signals import Signals
from servoloop.stack.tables import print_table

ARMS = [f"joint{number}" for number in range(1, 7)] + ["hand_right_joint"]


def printed(width: int, table: Table, *texts: str) -> str:
    console = Console(file=StringIO(), width=width)
    print_table(console, table, *texts)
    return console.file.getvalue()  # type: ignore[attr-defined,no-any-return]


def test_the_doctors_table_fits_into_80_columns() -> None:
    servos = tuple(
        ServoFigures(name, servo_id, "sts3215_c001", "well", None, -1.683, (12.0, 12.1), 27.0, 0.1, True, ("overload",))
        for servo_id, name in enumerate(ARMS, 1)
    )
    bus = BusFigures("", "/dev/ttyACM0", 1_000_000, None, None, servos, ())
    console = Console(file=StringIO(), width=80)
    print_report(DoctorReport((), (bus,)), console)
    text = console.file.getvalue()  # type: ignore[attr-defined]
    assert "…" not in text and max(map(len, text.splitlines())) <= 80
    assert text.count("-1.683") == len(ARMS) and text.count("overload") == len(ARMS)


def test_names_and_numbers_are_whole_at_80_columns() -> None:
    """The longest texts of ``doctor --arm so101``."""
    table = Table("joint", "ID", "model", "answers", "position", "V", "°C", "torque", "alarms")
    for name in ("shoulder_pan", "shoulder_lift"):
        table.add_row(name, "1", "sts3215_c001", "well", "-1.723", "7.4", "27", "off", "")
    text = printed(80, table, "joint", "model", "answers", "alarms")
    assert max(map(len, text.splitlines())) <= 80 and len(text.splitlines()) == 4
    assert "shoulder_pan " in text and "shoulder_lift" in text and "sts3215_c001" in text and "alarms" not in text


def test_a_long_text_is_wrapped_at_words_next_to_whole_names() -> None:
    table = Table("joint", "servo", "zero", "warning")
    table.add_row("shoulder_lift", "1", "2047", "not calibrated yet: run servoloop calibrate and then examine the arm")
    lines = printed(50, table, "joint", "warning").splitlines()
    assert max(map(len, lines)) <= 50 and "shoulder_lift" in lines[2]
    assert " ".join(line.split("│")[-1].strip() for line in lines[2:]).startswith("not calibrated yet: run servoloop")


def test_the_control_table_of_a_servo_is_printed_with_one_line_per_register(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    tables("sts3215")
    lines = capsys.readouterr().out.splitlines()
    assert any("min_position" in line and "0 to 65535" in line for line in lines) and max(map(len, lines)) <= 80


@pytest.mark.parametrize("width", [20, 40, 80])
def test_no_character_is_lost_at_any_width(width: int) -> None:
    row = ("abcdefghijklmnopqrst", "-1.6831", "max_torque 1000 to 500")
    table = Table("joint", "position", "written")
    table.add_row(*row)
    text = printed(width, table, "joint", "written")
    wanted = Counter("".join(row).replace(" ", ""))
    assert "…" not in text and not wanted - Counter(text)


BRACKETS = "Lower it [see the sticker], [/] not up :gear:"


@pytest.mark.parametrize("servos", [(), (ScannedServo(1, 1_000_000, "1.0"),)], ids=["none", "one"])
def test_a_port_with_brackets_is_printed_as_it_is(
    capsys: pytest.CaptureFixture[str], servos: tuple[ScannedServo, ...]
) -> None:
    port = "/tmp/[/x]/bus[1]"
    scan.print_report(ScanReport(port, servos, (), {}, (), ()), text_console())
    assert port in capsys.readouterr().out


def test_instructions_with_brackets_are_printed_as_they_are(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("servoloop.commands.shared.console.Keyboard.line", lambda keyboard: "")
    terminal = Terminal(Signals(), yes=True)
    terminal.say(BRACKETS)
    terminal.until_done(CalibrationTask("direction", BRACKETS, (), None), lambda: None)  # type: ignore[arg-type]
    assert capsys.readouterr().err == f"· {BRACKETS}\n{BRACKETS}; press Enter when done\n"


def test_messages_with_brackets_are_printed_as_they_are(capsys: pytest.CaptureFixture[str]) -> None:
    with LiveTable(text_console()) as table:
        table.draw(BRACKETS, Table)
    live = Live(text_console())
    live.say(BRACKETS)
    live.done("A", "left", True, BRACKETS)
    lines = [f"· {BRACKETS}", f"· {BRACKETS}", f"✓ grade A: cube in bin left {BRACKETS}"]
    assert capsys.readouterr().out.splitlines() == lines
