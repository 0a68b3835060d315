"""Contradictions in scenarios and schedules are reported with file and line before anything runs."""

from pathlib import Path

import pytest

from servoloop.campaign.campaign import Scenario, ScenarioError, read_scenario, schedule_of
from servoloop.campaign.shrink import shrink
from servoloop.simulation.schedule import Schedule, ScheduleError, read_schedule
from sim_backend.faults.text import parse
from tests.complaint import complaint


def written(folder: Path, text: str) -> Path:
    path = folder / "file.yaml"
    path.write_text(text)
    return path


def test_a_duration_is_refused_for_an_instantaneous_fault(tmp_path: Path) -> None:
    path = written(tmp_path, "seconds: 2\nfaults:\n- kind: brown_out\n  servo_id: 3\n  for_s: 1.0\n")
    with pytest.raises(ScheduleError) as refused:
        read_schedule(path)
    assert str(refused.value) == f"{path}:5: faults.0.brown_out.for_s: brown_out is over at once: leave out for_s"


def test_a_fault_after_the_end_of_a_run_without_jobs_is_refused(tmp_path: Path) -> None:
    late = "- {kind: echo, at_s: 2.5}\n- {kind: echo, at_s: 2.0}\n- {kind: echo, at_s: 9, since: end}\n"
    path = written(tmp_path, f"seconds: 2\nfaults:\n{late}")
    with pytest.raises(ScheduleError) as refused:
        read_schedule(path)
    assert str(refused.value) == (
        f"{path}:3: echo begins at 2.5 s, and the run ends after 2 s: let it begin earlier, make `seconds` longer, or "
        "write `since: end`"
    )
    assert len(read_schedule(written(tmp_path, f"seconds: 2\njob: [A]\nfaults:\n{late}")).faults) == 3


def test_minimized_schedules_can_be_read_again(tmp_path: Path) -> None:
    faults = (parse("silent id=3 at=1s"), parse("echo at=5s"))
    left = shrink(Schedule(seconds=2.0, job=("A",), faults=faults), lambda one: len(one.faults) == 2)
    assert left.job == ("A",)


def test_faults_of_a_scenario_without_jobs_are_drawn_within_its_run(tmp_path: Path) -> None:
    path = written(tmp_path, "seconds: 2\nwithin_s: 5\n")
    with pytest.raises(ScenarioError) as refused:
        read_scenario(path)
    assert str(refused.value) == (
        f"{path}:2: within_s: a fault after 2 s would not happen, as the run without jobs ends then: write at most "
        "`seconds`, or make `seconds` longer"
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
    assert "which says nothing of its encoder" in str(refused.value)
    assert read_scenario(path, "so101").kinds == ("silent", "dead_encoder")
    said = complaint(capsys, monkeypatch, "campaign", "--scenario", str(path), "--arm", "robot_arm_dynamixel")
    assert "robot_arm_dynamixel cannot have 'dead_encoder'" in said


def test_a_fault_that_the_arm_does_not_support_is_refused_with_its_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = written(tmp_path, "arm: koch\nseconds: 1\nfaults:\n- {kind: echo}\n- {kind: dead_encoder, servo_id: 3}\n")
    said = complaint(capsys, monkeypatch, "campaign", "--schedule", str(path))
    assert f"{path}:5: dead_encoder at 0 s: servo 3 is a " in said
