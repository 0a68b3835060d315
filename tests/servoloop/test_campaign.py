"""Tests of campaigns: equal results with any number of processes, and minimized schedules of violations."""

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from hal.gate import Gated, SafetyGate
from hal.types import FloatArray
from servoloop import cli
from servoloop.campaign.campaign import campaign, read_scenario, run_schedule_of, schedule_of
from servoloop.campaign.invariants.watch import ALL
from servoloop.campaign.scenario import Scenario, ScenarioError
from servoloop.campaign.shrink import shrink
from servoloop.simulation.schedule import Schedule, read_schedule, schedule_text
from sim_backend.faults.text import parse
from tests.complaint import complaint
from tests.drivers.fault_lines import CYCLES

ROOT = Path(__file__).parents[2]
KEPT = sorted((ROOT / "tests" / "schedules").glob("*.yaml"))
SCENARIO = Scenario(seconds=1.5, faults=3, within_s=1.2)


@pytest.mark.slow
def test_any_number_of_processes_gives_the_same_reports_in_the_same_order() -> None:
    alone, together = list(campaign(SCENARIO, range(3, 9), 0)), list(campaign(SCENARIO, range(3, 9), 2))
    assert alone == together == list(campaign(SCENARIO, range(3, 9), 1))
    assert [report.seed for report in alone] == [*range(3, 9)]


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(CYCLES // 100))
def test_no_invariant_is_violated_whatever_faults_happen(seed: int) -> None:
    scenario = read_scenario(ROOT / "docs" / "campaign.yaml")
    assert run_schedule_of(schedule_of(scenario, seed)).violations == ()


@pytest.mark.parametrize("file", KEPT, ids=lambda file: file.stem)
def test_a_violation_that_was_fixed_does_not_return(file: Path) -> None:
    assert run_schedule_of(read_schedule(file)).violations == ()


@pytest.mark.slow
def test_the_violation_of_a_broken_gate_is_found_minimized_and_kept(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def broken(gate: SafetyGate, wanted: FloatArray, *_: object) -> Gated:
        return Gated(wanted, {})

    monkeypatch.setattr(SafetyGate, "limit", broken)
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text("{seconds: 1.5, faults: 6, within_s: 1.2, kinds: [controller_jumps, noise, silent, hot]}")
    arguments = ["--scenario", str(scenario), "--seeds", "3", "--jobs", "0", "--out", str(tmp_path / "out"), "--json"]
    ran = CliRunner().invoke(cli.app, ["campaign", *arguments])
    assert ran.exit_code == 1, ran.output
    result = json.loads(ran.stdout)
    kept = read_schedule(Path(result["kept"]["safe commands"]))
    assert [event.kind for event in kept.faults] == ["controller_jumps"]
    assert {one["invariant"] for one in result["violations"]} == {"safe commands"}
    assert "safe commands" in {violation.invariant for violation in run_schedule_of(kept).violations}


def test_a_campaign_without_a_violation_ends_with_0(tmp_path: Path) -> None:
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text("{seconds: 0.5, faults: 1, within_s: 0.3, promises: {examined: [safe wire]}}")
    arguments = ["--scenario", str(scenario), "--seeds", "2", "--jobs", "0", "--out", str(tmp_path / "out")]
    ran = CliRunner().invoke(cli.app, ["campaign", *arguments])
    assert ran.exit_code == 0 and "no invariant was violated" in ran.output


def test_results_are_printed_even_if_the_report_cannot_be_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario, out = tmp_path / "scenario.yaml", tmp_path / "out"
    scenario.write_text("{seconds: 0.1, faults: 0, promises: {examined: []}}")
    (out / "report.html").mkdir(parents=True)
    arguments = ("--scenario", str(scenario), "--seeds", "1", "--jobs", "0", "--out", str(out))
    message = complaint(capsys, monkeypatch, "campaign", *arguments)
    assert f"cannot write {out / 'report.html'}: Is a directory" in message
    with pytest.raises(SystemExit):
        cli.main()
    assert "no invariant was violated" in capsys.readouterr().out


def test_the_documentation_lists_every_invariant_and_every_key() -> None:
    page = (ROOT / "docs" / "campaigns.md").read_text()
    assert [invariant.name for invariant in ALL if f"| {invariant.name} |" not in page] == []
    assert [key for key in Scenario.model_fields if f"| `{key}` |" not in page] == []


def test_a_campaign_that_breaks_its_promises_fails_and_lists_them(tmp_path: Path) -> None:
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text(
        "seconds: 0.5\nfaults: 1\nwithin_s: 0.3\nkinds: [noise]\n"
        "promises: {examined: [nan holds], visits: [{phase: canceling, fault: noise}, {fault: noise}]}\n"
    )
    arguments = ["--scenario", str(scenario), "--seeds", "2", "--jobs", "0", "--out", str(tmp_path / "out"), "--json"]
    ran = CliRunner().invoke(cli.app, ["campaign", *arguments])
    assert ran.exit_code == 1
    assert json.loads(ran.stdout)["broken_promises"] == [
        "the invariant 'nan holds' never examined its condition in 2 runs",
        "no visit with phase canceling, fault noise in 2 runs",
    ]


@pytest.mark.parametrize(
    ("promise", "text"),
    [
        ("{examined: [nan hold]}", "unknown invariant 'nan hold'"),
        ("{visits: [{phase: resting}]}", "unknown phase 'resting'"),
        ("{visits: [{fault: silence}]}", "unknown fault 'silence'"),
        ("{visits: [{make: dynamo}]}", "unknown make 'dynamo': choose one of dynamixel, feetech, none"),
        ("{visits: [{client: moves}]}", "unknown client action 'moves': choose one of job, move, plan, "),
    ],
)
def test_a_promise_with_an_unknown_name_is_refused_with_its_line(tmp_path: Path, promise: str, text: str) -> None:
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text(f"faults: 1\npromises: {promise}\n")
    with pytest.raises(ScenarioError, match=f"scenario.yaml:2: .*{text}"):
        read_scenario(scenario)


def test_each_seed_draws_an_arm_a_client_and_an_exit_policy() -> None:
    scenario = Scenario(arm=("robot_arm", "koch"), clients=("moves", "plans"), on_exit=("hold", "relax"), within_s=4.0)
    drawn = [schedule_of(scenario, seed) for seed in range(20)]
    assert {one.arm for one in drawn} == {"robot_arm", "koch"} and {one.on_exit for one in drawn} == {"hold", "relax"}
    assert {act.kind for one in drawn for act in one.clients} == {
        "configure",
        "move",
        "waypoints",
        "plan",
        "scale_speed",
        "cancel",
        "hand",
    }
    assert drawn == [schedule_of(scenario, seed) for seed in range(20)]


def test_a_saved_schedule_has_the_acts_of_its_client(tmp_path: Path) -> None:
    scenario = Scenario(clients=("moves", "switches", "streams"), on_exit=("relax",), within_s=4.0)
    for seed in range(10):
        schedule = schedule_of(scenario, seed)
        (tmp_path / "kept.yaml").write_text(schedule_text(schedule))
        assert read_schedule(tmp_path / "kept.yaml") == schedule


def test_mistakes_in_a_scenario_are_reported_before_the_first_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text("{seconds: -1, kind: [silent]}")
    message = complaint(capsys, monkeypatch, "campaign", "--scenario", str(scenario))
    assert "seconds" in message and "kind" in message
    with pytest.raises(ValueError, match="unknown fault silence"):
        Scenario(kinds=("silence",))


EVENTS = st.lists(
    st.tuples(st.sampled_from(["silent id=3", "noise", "hot id=2"]), st.floats(0.0, 9.0).map(lambda s: round(s, 3))),
    min_size=1,
    max_size=8,
)


@given(events=EVENTS)
def test_minimizing_leaves_only_the_fault_that_matters(events: list[tuple[str, float]]) -> None:
    """In this test, any silent servo at any time counts as a violation."""
    faults = tuple(parse(f"{text} at={at_s}s for=1s") for text, at_s in (*events, ("silent id=3", 4.321)))

    def breaks(schedule: Schedule) -> bool:
        return any(event.kind == "silent" for event in schedule.faults)

    (left,) = shrink(Schedule(seed=5, job=("A", "B"), faults=faults), breaks).faults
    assert left.kind == "silent" and left.at_s == round(left.at_s) and left.for_s is not None and left.for_s <= 0.1


def test_the_arm_on_the_command_line_replaces_the_arms_of_the_scenario(tmp_path: Path) -> None:
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text("{arm: nowhere, seconds: 0.3, faults: 0, promises: {examined: []}}")
    arguments = ["--scenario", str(scenario), "--arm", "so101", "--seeds", "1", "--jobs", "0"]
    ran = CliRunner().invoke(cli.app, ["campaign", *arguments, "--out", str(tmp_path / "out"), "--json"])
    assert ran.exit_code == 0, ran.output
    assert json.loads(ran.stdout)["runs"] == 1


def test_the_option_arm_is_refused_with_a_schedule(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    message = complaint(capsys, monkeypatch, "campaign", "--schedule", "any.yaml", "--arm", "so101")
    assert "--arm needs --scenario: the schedule any.yaml already names an arm" in message
