"""Commands of docs/monitor.md. tests/ros/test_monitoring.py runs the first command of the page on a running stack."""

import re
import shlex
import signal
import sys
from pathlib import Path

import pytest

from servoloop.dashboard.tables import STRIPS
from servoloop.dashboard.terminal import AT_FIRST, KEYS
from servoloop.recording.sources import SPEEDS
from tests.complaint import complaint
from tests.monitor.terminal import in_terminal
from tests.pages import DOCS, commands
from tests.recorder.rig import Rig

TEXT = (DOCS / "monitor.md").read_text()
LIVE, PLAYED, _ = commands("monitor.md")


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """Write ``job.mcap`` into a folder."""
    rig = Rig()
    rig.run(0.5)
    return rig.record(tmp_path / "job.mcap")


@pytest.mark.runs(PLAYED)
@pytest.mark.parametrize("end", ["q", "ctrl+c", "SIGTERM"])
def test_a_recording_is_played_in_a_terminal_which_is_restored_at_the_end(recording: Path, end: str) -> None:
    program, *arguments = shlex.split(PLAYED)
    assert program == "servoloop"
    with in_terminal(*arguments, folder=recording.parent) as terminal:
        terminal.wait_for("recording: job.mcap", "hand_right_joint", "12.0 V")
        if end == "SIGTERM":
            terminal.process.send_signal(signal.SIGTERM)
        else:
            terminal.press(b"q" if end == "q" else b"\x03")
        assert terminal.process.wait(30.0) == 0
        assert terminal.restored


def test_the_keys_and_figures_on_the_page_match_the_code() -> None:
    rows = dict(re.findall(r"^\| `(.)` \| (\w+)", TEXT, re.MULTILINE))
    assert {key: rows[key] for key in KEYS} == KEYS
    assert len(KEYS) == len(STRIPS) and all(
        name in strip.title for name, strip in zip(KEYS.values(), STRIPS, strict=True)
    )
    first = [KEYS[key] for key in AT_FIRST]
    assert f"At the start, {', '.join(first[:-1])} and {first[-1]} are shown." in " ".join(TEXT.split())
    assert f"{SPEEDS[0]} to {SPEEDS[-1]} times" in TEXT


def test_a_missing_terminal_is_reported(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, recording: Path
) -> None:
    assert "is not a terminal; run it in a terminal" in complaint(capsys, monkeypatch, "monitor", str(recording))


def test_a_missing_textual_is_reported_with_the_command_to_install_it(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "textual", None)
    assert "-m pip install" in complaint(capsys, monkeypatch, "monitor")


def test_an_arm_cannot_be_selected_for_a_recording(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, recording: Path
) -> None:
    said = complaint(capsys, monkeypatch, "monitor", str(recording), "--arm", "so101")
    assert "use only one of them" in said
