"""Output of ``servoloop hand`` about connected servos and joints."""

from typing import Any

import pytest
from typer.testing import CliRunner

from servoloop.cli import app

JOINT: dict[str, Any] = {"position": 0.1, "held": False, "arrived": True}


def printed(monkeypatch: pytest.MonkeyPatch, connected: tuple[bool, bool], *words: str) -> str:
    """Return the output of the command for an emulator with these servos connected."""
    answer = {
        name: {**JOINT, "servo_id": servo_id, "connected": there}
        for name, servo_id, there in zip(("pan", "grip"), (1, 6), connected, strict=True)
    }
    monkeypatch.setattr("sim_backend.control.ask", lambda path, command: answer)
    result = CliRunner().invoke(app, ["hand", "bus", *words])
    assert result.exit_code == 0, result.output
    return result.output


@pytest.mark.parametrize(
    ("connected", "words", "expected"),
    [
        ((False, True), ("connect", "grip"), "connected: grip (ID 6)\n"),
        ((True, True), ("connect",), "connected (all servos): pan (ID 1), grip (ID 6)\n"),
        ((False, False), ("disconnect",), "No servo is connected.\n"),
    ],
)
def test_connect_prints_what_is_connected(
    monkeypatch: pytest.MonkeyPatch, connected: tuple[bool, bool], words: tuple[str, ...], expected: str
) -> None:
    assert printed(monkeypatch, connected, *words) == expected


def test_look_prints_positions(monkeypatch: pytest.MonkeyPatch) -> None:
    assert printed(monkeypatch, (True, True), "look").startswith("pan                 +0.1000  free\n")
