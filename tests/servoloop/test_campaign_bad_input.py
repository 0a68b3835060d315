"""Contradictions in scenarios and schedules are reported in one sentence with file and line before the first run."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from hal.hal_errors import ArmFileError
from servoloop.campaign import shrink as minimizing
from servoloop.campaign.campaign import read_scenario, schedule_of
from servoloop.campaign.scenario import Scenario, ScenarioError
from servoloop.campaign.shrink import shrink, violated
from servoloop.cli import app
from servoloop.simulation.acts import Cancel, Move
from servoloop.simulation.schedule import Schedule, ScheduleError, read_schedule
from sim_backend.faults.text import parse
from tests.complaint import complaint as refusal


def written(folder: Path, text: str) -> Path:
    path = folder / "file.yaml"
    path.write_text(text)
    return path


def test_a_momentary_fault_with_a_duration_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path, "seconds: 2\nfaults:\n- kind: brown_out\n  servo_id: 3\n  for_s: 1.0\n")
    with pytest.raises(ScheduleError) as refused:
        read_schedule(path)
    assert str(refused.value) == f"{path}:5: faults.0.brown_out.for_s: brown_out has no duration: omit for_s"


def test_a_fault_after_the_end_of_a_run_without_jobs_is_refused(tmp_path: Path) -> None:
    late = "- {kind: echo, at_s: 2.5}\n- {kind: echo, at_s: 2.0}\n- {kind: echo, at_s: 9, since: end}\n"
    path = written(tmp_path, f"seconds: 2\nfaults:\n{late}")
    with pytest.raises(ScheduleError) as refused:
        read_schedule(path)
    assert str(refused.value) == (
        f"{path}:3: echo starts at 2.5 s, but the run ends after 2 s: start it earlier, increase `seconds`, or use "
        "`since: end`"
    )
    assert len(read_schedule(written(tmp_path, f"seconds: 2\njob: [A]\nfaults:\n{late}")).faults) == 3


def test_freedrive_of_a_client_besides_programs_on_the_command_socket_is_refused(tmp_path: Path) -> None:
    guide = "seconds: 2\nclients:\n- {kind: cancel, at_s: 0.1}\n- {kind: guide, joint: joint1, share: 0.5, at_s: 0.1}\n"
    path = written(tmp_path, f"{guide}- {{kind: socket_request, op: state, at_s: 0.2}}\n")
    with pytest.raises(ScheduleError) as refused:
        read_schedule(path)
    assert str(refused.value) == (
        f"{path}:4: guide cannot be combined with actions on the command socket, because the freedrive of a stack "
        "belongs to the programs on this socket: use socket_request with `op: freedrive`, or remove the actions on the "
        "socket"
    )
    assert len(read_schedule(written(tmp_path, guide)).clients) == 2


def test_minimizing_yields_only_schedules_that_can_be_read(tmp_path: Path) -> None:
    faults = (parse("silent id=3 at=1s"), parse("echo at=5s"))
    left = shrink(Schedule(seconds=2.0, job=("A",), faults=faults), lambda one: len(one.faults) == 2)
    assert left.job == ("A",)


def test_faults_of_a_scenario_without_jobs_are_drawn_within_its_run(tmp_path: Path) -> None:
    path = written(tmp_path, "seconds: 2\nwithin_s: 5\n")
    with pytest.raises(ScenarioError) as refused:
        read_scenario(path)
    assert str(refused.value) == (
        f"{path}:2: within_s: a run without jobs ends after 2 s, so later faults would not happen: "
        "set `within_s` to at most `seconds`, or increase `seconds`"
    )
    drawn = [event for seed in range(20) for event in schedule_of(Scenario(seconds=0.5), seed).faults]
    assert max(event.at_s for event in drawn if event.since == "up") <= 0.5


def test_a_fault_kind_that_no_servo_of_the_arm_supports_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = written(tmp_path, "arm: koch\nseconds: 1\nwithin_s: 1\nkinds:\n- silent\n- dead_encoder\n")
    with pytest.raises(ScenarioError) as refused:
        read_scenario(path)
    assert f"{path}:6: koch cannot have 'dead_encoder': servo " in str(refused.value)
    assert "which does not report the state of its encoder" in str(refused.value)
    assert read_scenario(path, "so101").kinds == ("silent", "dead_encoder")
    message = refusal(capsys, monkeypatch, "campaign", "--scenario", str(path), "--arm", "robot_arm_dynamixel")
    assert "robot_arm_dynamixel cannot have 'dead_encoder'" in message


def test_a_fault_that_the_arm_does_not_support_is_refused_with_its_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = written(tmp_path, "arm: koch\nseconds: 1\nfaults:\n- {kind: echo}\n- {kind: dead_encoder, servo_id: 3}\n")
    message = refusal(capsys, monkeypatch, "campaign", "--schedule", str(path))
    assert f"{path}:5: dead_encoder at 0 s: servo 3 is an " in message


CHANGE = ": change the scenario or remove the promise"


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("faults: 2\nspeed: 3\n", "2: speed: is not a known key"),
        ("faults: 2\narm: [koch,\n  coch]\n", "3: there is no arm coch: choose one of "),
        ("faults: 2\nseldom: [koch,\n  coch]\n", "3: there is no arm coch: choose one of "),
        ("arm: []\n", "1: arm: the list is empty: add at least one item, or remove the key"),
        ("faults: 1\nkinds: []\n", "2: kinds: the list is empty: add at least one item, or remove the key"),
        (
            "clients: [jobs]\n",
            "1: clients.0: must be 'job', 'moves', 'plans', 'streams', 'switches', 'jogs', 'guides', 'grips' or "
            "'sockets'",
        ),
        ("job: [A,\n  F]\n", "2: robot_arm has no bin for the grade 'F': choose one of A, B, C"),
        (
            "clients: [moves]\njob: [A]\n",
            "2: job: no client runs jobs: add `job` to `clients`, or remove `job`",
        ),
    ],
)
def test_a_scenario_is_refused_with_one_sentence_and_its_line(tmp_path: Path, text: str, complaint: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises((ScenarioError, ArmFileError)) as refused:
        read_scenario(path)
    assert str(refused.value).startswith(f"{path}:{complaint}") and str(refused.value).count("\n") == 0


@pytest.mark.parametrize(
    ("scenario", "visit", "reason"),
    [
        ("faults: 0", "phase: idle", "`faults` is 0, but every visit needs a fault"),
        ("kinds: [noise]", "fault: silent", "no run has the fault 'silent', because `kinds` does not include it"),
        ("arm: koch", "fault: dead_encoder", "no arm of the scenario can have 'dead_encoder' (servo "),
        ("faults: 3", "make: dynamixel", "a fault cannot affect the make 'dynamixel', only feetech, none"),
        (
            "arm: [robot_arm, koch]",
            "{fault: dead_encoder, make: dynamixel}",
            "'dead_encoder' cannot affect the make 'dynamixel', only feetech",
        ),
        ("arm: koch", "{fault: stall, make: dynamixel}", "'stall' cannot affect the make 'dynamixel', only none"),
        ("clients: [plans]", "client: switch", "no client of the scenario does 'switch', only cancel, job, plan"),
    ],
)
def test_a_promise_that_no_run_can_keep_is_refused(tmp_path: Path, scenario: str, visit: str, reason: str) -> None:
    path = written(tmp_path, f"{scenario}\npromises:\n  visits:\n  -\n    {visit}\n")
    with pytest.raises(ScenarioError) as refused:
        read_scenario(path)
    text = str(refused.value)
    assert text.startswith(f"{path}:5: {reason}") and text.endswith(CHANGE) and text.count("\n") == 0


def test_a_promise_that_some_run_can_keep_is_accepted(tmp_path: Path) -> None:
    visits = "[{fault: dead_encoder, make: feetech}, {make: none}, {fault: silent, make: dynamixel, client: hand}]"
    path = written(tmp_path, f"arm: [robot_arm, koch]\nclients: [job, streams]\npromises: {{visits: {visits}}}\n")
    assert len(read_scenario(path).promises.visits) == 3


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (
            "seconds: 2\nclients:\n- kind: cancel\n  at_s: 2.5\n",
            "4: cancel starts at 2.5 s, but the run ends after 2 s: start it earlier, or increase `seconds`",
        ),
        (
            "seconds: 2\nclients:\n- kind: jog\n  share: 0.5\n  joint: joint9\n",
            "5: the arm has no joint 'joint9': choose one of joint1, joint2, joint3, joint4, joint5, joint6",
        ),
        (
            "seconds: 2\nclients:\n- kind: move\n  positions: {joint1: 0.1,\n    joint9: 0.1}\n",
            "5: the arm has no joint 'joint9': choose one of joint1, joint2, joint3, joint4, joint5, joint6",
        ),
        ("seconds: 2\njob:\n- F\n", "3: robot_arm has no bin for the grade 'F': choose one of A, B, C"),
        (
            "seconds: 2\nlimits:\n  joint9: [0, 1]\n",
            "3: the arm has no joint 'joint9': choose one of joint1, joint2, joint3, joint4, joint5, ",
        ),
        (
            "seconds: 2\nlimits:\n  joint1: [-1, 4]\n",
            "3: -1 to 4 is not a range within the limits of joint1, -3.05 to 3.05",
        ),
        (
            "arm: koch\nlimits: {elbow_flex: [-0.5, 0.1]}\n",
            "2: elbow_flex parks at -0.808, outside -0.5 to 0.1: widen the range",
        ),
        ("seconds: 2\nspeed: 2\n", "2: speed: is not a known key"),
        ("seconds: 2\nclients: [{kind: moves}]\n", "2: clients.0: has the unknown kind 'moves': use one of "),
    ],
)
def test_a_schedule_is_refused_with_one_sentence_and_its_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, text: str, complaint: str
) -> None:
    path = written(tmp_path, text)
    message = refusal(capsys, monkeypatch, "campaign", "--schedule", str(path))
    assert message.startswith(f"servoloop: {path}:{complaint}") and message.count("\n") == 1


def test_minimizing_does_not_run_an_arm_that_cannot_do_the_acts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(minimizing, "run_schedule_of", None)
    move = Move(positions={"shoulder_pan": 0.1})
    assert violated(Schedule(arm="robot_arm", seconds=2.0, clients=(move,))) == set()
    late = Schedule(seconds=4.0, clients=(Cancel(at_s=3.5),))
    assert shrink(late, lambda one: bool(one.clients)).seconds == 4.0


def test_seeds_out_of_range_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    arguments = ("campaign", "--scenario", str(written(tmp_path, "seconds: 1\n")), "--jobs", "0")
    ran = CliRunner().invoke(app, [*arguments, f"--first={2**63}"])
    assert ran.exit_code == 2 and "Invalid value for '--first'" in ran.output
    message = refusal(capsys, monkeypatch, *arguments, f"--first={2**63 - 1}", "--seeds=2")
    assert f"2 runs from seed {2**63 - 1} would exceed the largest seed {2**63 - 1}" in message
