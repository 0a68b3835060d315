"""Tests of the report of a campaign and of its traces."""

import csv
import json
import shlex
import sys
from collections.abc import Callable
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from hal.gate import Gated, SafetyGate
from hal.types import FloatArray, JointState
from servoloop import cli
from servoloop.campaign import report as reports
from servoloop.campaign.campaign import campaign, run_schedule_of
from servoloop.campaign.kept_violation import BEFORE_S, CYCLES_BEHIND
from servoloop.campaign.scenario import Scenario
from servoloop.campaign.tally import INVARIANTS, Tally
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.schedule import Schedule, schedule_text
from servoloop.stack.processes import Interrupted
from servoloop.stack.signals import Signals
from sim_backend.faults.text import parse
from tests.complaint import complaint

PERIOD_S = 0.05
JUMPS = Schedule(
    seconds=3.5, faults=(parse("silent id=3 at=1.2s for=0.5s"), parse("controller_jumps by=1.1 at=2.8s for=0.1s"))
)


class Page(HTMLParser):
    """Links and tags of a page, and its texts by the class of their element. Parsing raises an error if tags do not
    match."""

    VOID = ("meta", "br", "hr", "img", "link", "input")

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.tags: list[str] = []
        self.texts: dict[str, list[str]] = {}
        self._open: list[tuple[str, str]] = []
        self.feed(text)
        assert not self._open, f"not closed: {self._open}"

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        found = dict(attributes)
        self.links += [
            found[name] or "" for name in found if name.rpartition(":")[2] in ("src", "href", "srcset", "data")
        ]
        if tag in self.VOID:
            return
        self._open.append((tag, found.get("class") or ""))
        self.texts.setdefault(self._open[-1][1], []).append("")

    def handle_startendtag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attributes)
        if tag not in self.VOID:
            self.handle_endtag(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop()[0] == tag

    def handle_data(self, data: str) -> None:
        if self._open:
            self.texts[self._open[-1][1]][-1] += data


@pytest.fixture
def open_gate(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> pytest.MonkeyPatch:
    """Make the safety gate pass every command, and change to an empty folder."""

    def limit(gate: SafetyGate, wanted: FloatArray, *_: object) -> Gated:
        return Gated(wanted, {})

    monkeypatch.setattr(SafetyGate, "limit", limit)
    monkeypatch.chdir(tmp_path)
    return monkeypatch


def run(*words: str) -> Any:
    return CliRunner().invoke(cli.app, ["campaign", *words])


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def commanded(schedule: Schedule) -> dict[float, dict[str, float]]:
    """Return the commands of each cycle of a run, by the time of the cycle."""
    found: dict[float, dict[str, float]] = {}

    def prepare(stack: FaultyStack) -> None:
        def on_state(state: JointState) -> None:
            loop = stack.loop
            found[stack.clock.now()] = dict(zip(loop.hardware.command_interfaces, loop.command.tolist(), strict=True))

        stack.on_state = on_state

    run_schedule_of(schedule, prepare)
    return found


def test_a_trace_has_the_two_seconds_before_the_violation_with_the_commands(
    open_gate: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "jumps.yaml").write_text(schedule_text(JUMPS))
    result = json.loads(run("--schedule", "jumps.yaml", "--json").stdout)
    (violated_s,) = (one["time_s"] for one in result["violations"] if one["invariant"] == "safe commands")
    rows = rows_of(Path(result["traces"]["safe commands"]))
    times = [float(row["time_s"]) for row in rows]
    assert times[0] == pytest.approx(violated_s - BEFORE_S, abs=PERIOD_S)
    assert times[-1] == pytest.approx(violated_s + CYCLES_BEHIND * PERIOD_S, abs=PERIOD_S)
    assert all(later - earlier == pytest.approx(PERIOD_S, abs=0.01) for earlier, later in pairwise(times))
    truth = commanded(JUMPS)
    assert len(times) > BEFORE_S / PERIOD_S and set(times) <= set(truth)
    for time_s, row in zip(times, rows, strict=True):
        traced = {name.removeprefix("command/"): float(value) for name, value in row.items() if "command/" in name}
        assert traced == truth[time_s]


@pytest.mark.parametrize("blocked", ["jumps.html", "jumps-safe-commands.csv"])
def test_violations_are_printed_even_if_a_file_cannot_be_written(
    open_gate: pytest.MonkeyPatch, tmp_path: Path, blocked: str
) -> None:
    (tmp_path / "jumps.yaml").write_text(schedule_text(JUMPS))
    (tmp_path / "out" / blocked).mkdir(parents=True)
    ran = run("--schedule", "jumps.yaml", "--out", "out")
    assert f"cannot write out/{blocked}: Is a directory" in str(ran.exception)
    assert "safe commands: at" in ran.stdout and "no invariant was violated" not in ran.stdout


def test_a_trace_names_faults_states_and_packets(open_gate: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "jumps.yaml").write_text(schedule_text(JUMPS))
    result = json.loads(run("--schedule", "jumps.yaml", "--json").stdout)
    rows = rows_of(Path(result["traces"]["safe commands"]))
    silent = [row for row in rows if row["injected"].startswith("silent")][1:]
    assert len(silent) >= 8 and {row["faults"] for row in silent} == {"joint3: silent"}
    assert rows[0]["faults"] == rows[-1]["faults"] == ""
    assert all("< " in row["packets"] and "> SYNC_READ present_position" in row["packets"] for row in rows)
    assert not any("; 3: " in row["packets"] for row in silent), "a silent servo has answered"
    assert {row["injected"] for row in rows} == {
        "",
        "silent id=3 at=1.2s for=0.5s",
        "controller_jumps by=1.1 at=2.8s for=0.1s",
    }
    assert {row["hardware"] for row in rows} == {"active"}
    assert all("arm_controller: active" in row["controllers"] for row in rows)


@pytest.mark.slow
def test_the_page_needs_no_network_and_shows_the_violations(open_gate: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "scenario.yaml").write_text(
        "{seconds: 1.5, faults: 6, within_s: 1.2, kinds: [controller_jumps, noise, silent, hot]}"
    )
    words = ("--scenario", "scenario.yaml", "--seeds", "3", "--jobs", "0")
    first = run(*words)
    assert first.exit_code == 1, first.output
    written = Path("out/campaign/report.html")
    text = written.read_text()
    page = Page(text)
    assert not [link for link in page.links if not link.startswith("#")]
    assert not {"script", "link", "img", "iframe", "object", "image"} & set(page.tags)
    assert "url(http" not in text and "@import" not in text
    assert page.tags.count("svg") == 5 + 1
    (kept,), (command,) = page.texts["schedule"], page.texts["command"]
    path = Path("out/campaign/safe-commands-seed-0.yaml")
    assert path.read_text().partition("\n")[2].strip() == kept.strip()
    assert command == f"servoloop campaign --schedule {path}" and command in first.output
    assert all(name in text for name in (*INVARIANTS, "controller_jumps", "joint6", "SYNC_WRITE"))
    before = written.read_bytes(), path.with_suffix(".csv").read_bytes()
    run(*words)
    assert (written.read_bytes(), path.with_suffix(".csv").read_bytes()) == before


@pytest.mark.slow
def test_the_command_on_the_page_reproduces_the_violation_until_it_is_fixed(
    open_gate: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "scenario.yaml").write_text("{seconds: 1.5, faults: 2, within_s: 1.2, kinds: [controller_jumps]}")
    run("--scenario", "scenario.yaml", "--seeds", "1", "--jobs", "0")
    (command,) = Page(Path("out/campaign/report.html").read_text()).texts["command"]
    again = run(*shlex.split(command)[2:])
    assert again.exit_code == 1 and "safe commands: at" in again.output
    traces = [Path(f"out/campaign/safe-commands-seed-0{more}.csv") for more in ("", "-safe-commands")]
    assert traces[0].read_bytes() == traces[1].read_bytes()
    assert "safe commands" in Path("out/campaign/safe-commands-seed-0.html").read_text()
    open_gate.undo()
    open_gate.chdir(tmp_path)
    fixed = run(*shlex.split(command)[2:])
    assert fixed.exit_code == 0 and "no invariant was violated" in fixed.output


@pytest.mark.slow
def test_a_crash_is_traced_too(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    limit, calls = SafetyGate.limit, []

    def breaks(*arguments: Any) -> Gated:
        calls.append(1)
        if len(calls) == 50:
            raise ZeroDivisionError("division by <zero>")
        return limit(*arguments)

    monkeypatch.setattr(SafetyGate, "limit", breaks)
    (tmp_path / "still.yaml").write_text("seconds: 5.0\n")
    ran = run("--schedule", str(tmp_path / "still.yaml"), "--out", str(tmp_path))
    assert ran.exit_code == 1 and "no crash: at 2.4" in ran.output
    assert len(rows_of(tmp_path / "still-no-crash.csv")) == pytest.approx(BEFORE_S / PERIOD_S, abs=2)
    Page((tmp_path / "still.html").read_text())


def test_an_interrupted_campaign_reports_the_completed_runs_and_ends_with_130(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scenario.yaml").write_text("{seconds: 0.3, faults: 1, within_s: 0.3, promises: {examined: []}}")
    add: Callable[..., None] = Tally.add

    def add_and_interrupt(tally: Tally, report: Any) -> None:
        add(tally, report)
        if len(tally.rows) == 2:
            signals[0].ask()

    signals = signals_of_the_command(monkeypatch)
    monkeypatch.setattr(Tally, "add", add_and_interrupt)
    ran = run("--scenario", "scenario.yaml", "--seeds", "50", "--jobs", "0", "--json")
    assert isinstance(ran.exception, Interrupted)  # The program then ends with exit status 130.
    assert "interrupted: 2 of 50 runs were completed" in str(ran.exception)
    assert json.loads(ran.stdout)["interrupted"] and json.loads(ran.stdout)["runs"] == 2
    assert "Interrupted: 2 of 50 runs were completed." in Path("out/campaign/report.html").read_text()


def signals_of_the_command(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Return a list to which the Signals object of the command will be added."""
    made: list[Any] = []
    enter = Signals.__enter__

    def enter_and_keep(signals: Any) -> Any:
        made.append(signals)
        return enter(signals)

    monkeypatch.setattr(Signals, "__enter__", enter_and_keep)
    return made


def test_a_campaign_that_is_interrupted_at_once_has_a_page_too() -> None:
    scenario = Scenario(seconds=0.5, faults=1, within_s=0.3)
    page = reports.page(Tally(scenario, 10), [])
    assert "Interrupted: 0 of 10 runs were completed." in page
    Page(page)
    assert list(campaign(scenario, range(10), 0, lambda: True)) == []


def test_names_are_escaped_on_the_page(tmp_path: Path) -> None:
    tally = Tally(Scenario(arm=("<b>arm</b>",)), 0)
    assert "<b>arm" not in reports.page(tally, [])


def test_a_missing_library_is_reported_with_the_command_that_installs_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    (tmp_path / "still.yaml").write_text("seconds: 0.5\n")
    ran = run("--schedule", str(tmp_path / "still.yaml"), "--out", str(tmp_path))
    assert ran.exit_code == 0 and "-m pip install" in ran.output
    assert not list(tmp_path.glob("*.html"))


def test_exactly_one_of_scenario_and_schedule_is_needed(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "specify one file: --scenario" in complaint(capsys, monkeypatch, "campaign")
    both = ("campaign", "--scenario", "a.yaml", "--schedule", "b.yaml")
    assert "specify one file: --scenario" in complaint(capsys, monkeypatch, *both)


def test_every_fault_is_counted_by_its_kind_and_its_time() -> None:
    scenario = Scenario(seconds=3.0, faults=5, within_s=3.0)
    tally, seen = Tally(scenario, 2), list(campaign(scenario, range(2), 0))
    for report in seen:
        tally.add(report)
    assert tally.drawn.total() == 2 * 5
    assert tally.begun.total() == sum(event.since == "up" for report in seen for event in report.schedule.faults)
    assert {kind for kind, _ in tally.drawn} == {event.kind for report in seen for event in report.schedule.faults}
    assert {second for second, _ in tally.begun} <= {0, 1, 2, 3}
    assert not tally.interrupted and tally.simulated_s == sum(report.simulated_s for report in seen)
