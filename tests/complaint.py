"""Run failing commands within the test process, because a separate process would take a second for each command."""

import sys

import pytest

from servoloop import cli


def complaint(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, *arguments: str) -> str:
    """Run a command that must fail, and return its error output."""
    monkeypatch.setattr(sys, "argv", ["servoloop", *arguments])
    with pytest.raises(SystemExit) as exit_:
        cli.main()
    assert exit_.value.code == 1
    return capsys.readouterr().err
