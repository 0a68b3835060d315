"""Tests of docs/campaigns.md: its commands, run with fewer seeds, and its tables."""

import json
import re
import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

from servoloop.campaign.campaign import files_of, read_scenario
from servoloop.campaign.invariants.watch import ALL
from servoloop.campaign.kept_violation import recorded
from servoloop.campaign.visits import PHASES
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
def test_the_commands_work(command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if "--ray" in command:
        pytest.importorskip("ray", reason="Ray is not installed: pip install 'servoloop[ray]'")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "docs").symlink_to(DOCS)
    (tmp_path / KEPT).parent.mkdir(parents=True)
    (tmp_path / KEPT).write_text("seconds: 0.5\n")
    words = shlex.split(command.replace("--seeds 1000", "--seeds 2 --jobs 2"))
    assert words[:2] == ["servoloop", "campaign"]
    ran = CliRunner().invoke(app, words[1:])
    assert ran.exit_code == 0 or "not examined: " in ran.output, ran.output  # Two runs rarely examine every condition.
    assert "no invariant was violated" in ran.output and list((tmp_path / "out" / "campaign").glob("*.html"))


def test_the_table_has_every_column_of_a_trace() -> None:
    schedule = Schedule(seconds=0.3)
    _, recording = recorded(schedule)
    header = trace_text(recording, files_of(schedule.arm).robot.joints).partition("\n")[0].split(",")
    assert len(header) > 20
    for name in header:
        shown = re.sub(r"(hand_right_)?joint\d?", "joint1", name)
        assert f"`{shown}`" in TEXT, f"docs/campaigns.md does not describe the column {name}"


def section(heading: str) -> str:
    return TEXT.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]


def rows(heading: str) -> list[list[str]]:
    """Return the cells of all tables of a section."""
    found = re.findall(r"^\| (.*) \|$", section(heading), re.MULTILINE)
    return [row.split(" | ") for row in found]


def test_the_page_explains_every_invariant_and_what_it_counts() -> None:
    names = [kind.name for kind in ALL]
    explained = [row[0] for row in rows("Invariants")]
    assert explained[1 : len(ALL) + 1] == names
    counted = [name for row in rows("Coverage") for name in row[1].split("; ") if name in names]
    assert sorted(counted) == sorted(names)


def test_the_page_explains_every_phase_of_a_visit() -> None:
    assert [row[0] for row in rows("Coverage") if row[0].startswith("`")] == [f"`{phase}`" for phase in PHASES]


@pytest.mark.runs(f"{PAGE} yaml 1")
def test_the_promises_on_the_page_can_be_read(tmp_path: Path) -> None:
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text(code(PAGE, "yaml"))
    promises = read_scenario(scenario).promises
    assert promises.examined == ("safe wire", "cancels are followed")
    visits = [str(visit) for visit in promises.visits]
    assert visits == ["phase canceling, fault silent", "fault brown_out, make dynamixel"]


@pytest.mark.slow
@pytest.mark.runs(f"{PAGE} yaml 2")
def test_the_schedule_of_the_page_can_be_run(tmp_path: Path) -> None:
    schedule = tmp_path / "schedule.yaml"
    schedule.write_text(code(PAGE, "yaml", 2))
    ran = CliRunner().invoke(app, ["campaign", "--schedule", str(schedule), "--out", str(tmp_path), "--json"])
    assert ran.exit_code == 0 and json.loads(ran.stdout)["violations"] == []
