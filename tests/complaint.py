"""The command line in the test's own process, where it must fail: a process for each mistake would take a second."""

import sys

import pytest

from servoloop import cli


def complaint(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, *arguments: str) -> str:
    """Run the command line, which must fail; returns what it says."""
    monkeypatch.setattr(sys, "argv", ["servoloop", *arguments])
    with pytest.raises(SystemExit) as exit_:
        cli.main()
    assert exit_.value.code == 1
    return capsys.readouterr().err
