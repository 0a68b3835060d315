"""Commands of docs/campaigns.md, run with fewer seeds, and its table of trace columns."""

import re
import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

from servoloop.campaign.campaign import files_of, read_scenario
from servoloop.campaign.fallen import recorded
from servoloop.cli import app
from servoloop.simulation.schedule import Schedule
from servoloop.simulation.trace_file import trace_text
from tests.pages import DOCS, code, commands

PAGE = "campaigns.md"
TEXT = (DOCS / PAGE).read_text()
COMMANDS = commands(PAGE)
KEPT = "out/campaign/safe-commands-seed-0.yaml"


@pytest.mark.slow
@pytest.mark.runs(*COMMANDS)
@pytest.mark.parametrize("command", COMMANDS)
def test_the_commands_of_the_page_work(command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if "--ray" in command:
        pytest.importorskip("ray", reason="Ray is not installed: pip install 'servoloop[ray]'")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "docs").symlink_to(DOCS)
    (tmp_path / KEPT).parent.mkdir(parents=True)
    (tmp_path / KEPT).write_text("seconds: 0.5\n")
    words = shlex.split(command.replace("--seeds 1000", "--seeds 2 --jobs 2"))
    assert words[:2] == ["servoloop", "campaign"]
    ran = CliRunner().invoke(app, words[1:])
    assert ran.exit_code == 0 or "not looked at: " in ran.output, ran.output  # in two runs
    assert "no invariant was violated" in ran.output and list((tmp_path / "out" / "campaign").glob("*.html"))


def test_the_table_has_every_column_of_a_trace() -> None:
    schedule = Schedule(seconds=0.3)
    _, recording = recorded(schedule)
    header = trace_text(recording, files_of(schedule.arm).robot.joints).partition("\n")[0].split(",")
    assert len(header) > 20
    for name in header:
        shown = re.sub(r"(hand_right_)?joint\d?", "joint1", name)
        assert f"`{shown}`" in TEXT, f"docs/campaigns.md says nothing of the column {name}"


@pytest.mark.runs(f"{PAGE} yaml 1")
def test_the_promises_of_the_page_are_those_of_a_scenario(tmp_path: Path) -> None:
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text(code(PAGE, "yaml"))
    promises = read_scenario(scenario).promises
    assert promises.examined == ("safe wire", "cancels are followed")
    visits = [str(visit) for visit in promises.visits]
    assert visits == ["phase canceling, fault silent", "fault brown_out, make dynamixel"]
