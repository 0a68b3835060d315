"""Sanitizing text from outside for logs and terminals."""

import logging
import os

import pytest
import typer

from controller.loop_figures import LoopFigures
from drivers.driver_errors import DriverError
from drivers.port.owners import line_advice
from drivers.printable import PrintableFormatter, counted, printable
from hal.servos.diagnose import intermittent_text
from servoloop import cli
from servoloop.stack.terminal import log_to_terminal
from tests.complaint import complaint

EVIL = "joint\n\x1b[2J\x9b31m\u202e\x00"


def test_control_characters_are_escaped_and_letters_are_kept() -> None:
    assert printable(EVIL) == "joint\n\\x1b[2J\\x9b31m\\u202e\\x00"
    assert printable("größe – 関節\tx") == "größe – 関節\tx"
    assert printable("\ud800") == "\\ud800"


def test_long_lines_and_many_lines_are_cut() -> None:
    assert len(printable("j" * 1_000_000)) < 600 and "(1000000 characters)" in printable("j" * 1_000_000)
    assert printable("a\n" * 1000).count("\n") == 200


def test_a_log_message_with_line_breaks_remains_one_message() -> None:
    record = logging.LogRecord("servoloop", logging.ERROR, "", 0, "no joint %s", (f"a\nERROR {EVIL}",), None)
    assert PrintableFormatter("%(levelname)s: %(message)s").format(record).split("\n")[1] == "    ERROR joint"


def test_programs_use_the_formatter_for_terminals(monkeypatch: pytest.MonkeyPatch) -> None:
    root = logging.RootLogger(logging.WARNING)
    monkeypatch.setattr(logging, "root", root)
    log_to_terminal()
    (handler,) = root.handlers
    assert isinstance(handler.formatter, PrintableFormatter)


def test_errors_of_commands_are_sanitized(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    def fail() -> None:
        raise DriverError(f"no joint {EVIL}")

    app = typer.Typer()
    app.command()(fail)
    monkeypatch.setattr(cli, "app", app)
    output = complaint(capsys, monkeypatch)
    assert "\x1b[2J" not in output and "\\x1b[2J" in output


def test_nouns_agree_with_their_numbers() -> None:
    assert [counted(number, "cycle") for number in (0, 1, 2)] == ["0 cycles", "1 cycle", "2 cycles"]
    assert LoopFigures(missed=1, unmeasured=1).summary == "1 cycle missed, 1 cycle without a measurement"


def test_the_advice_for_a_virtual_bus_does_not_name_plugs() -> None:
    master, slave = os.openpty()
    device = os.ttyname(slave)
    assert "plugs" not in line_advice(device) and "virtual bus" in line_advice(device)
    assert line_advice("/dev/ttyUSB0") == "the cable's plugs"
    assert "virtual bus" in intermittent_text(1, device)
    os.close(master), os.close(slave)
