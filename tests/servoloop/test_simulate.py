"""``servoloop simulate``: jobs in simulated time, with reproducible digests."""

import json
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pick_place.job import JobPhase
from pick_place.settings import JobSettings
from servoloop import cli
from servoloop.simulation.job import run_job
from servoloop.simulation.schedule import Schedule, ScheduleError, read_schedule
from servoloop.simulation.simulate import simulate
from servoloop.simulation.stack import SimulatedStack
from servoloop.stack.robot_files import read_files
from servoloop.stack.shipped_files import HOME
from sim_backend.buses.build import Build
from sim_backend.faults.fault_error import FaultError
from sim_backend.faults.text import parse
from tests.complaint import complaint
from tests.pages import commands

PAGE = "simulation.md"
COMMAND, *_ = commands(PAGE)
SHORT = ["simulate", "--seed", "1", "--seconds", "1.5", "--json"]


@pytest.mark.slow
def test_two_processes_print_the_same_digest_and_another_arm_a_different_one() -> None:
    once = subprocess.run([sys.executable, "-m", "servoloop", *SHORT], capture_output=True, text=True, check=True)
    here, other = (simulate(read_files(), {"": JobSettings()}, Schedule(seed=seed, seconds=1.5)) for seed in (1, 2))
    assert json.loads(once.stdout)["digest"] == here.digest != other.digest
    assert here.cycles == pytest.approx(4.0 * 20, abs=2) and here.missed_cycles == 0


def other_python() -> str | None:
    """Return another supported Python from PATH or pyenv."""
    mine = f"{sys.version_info.major}.{sys.version_info.minor}"
    for version in sorted({"3.13", "3.12", "3.11"} - {mine}, reverse=True):
        installed = Path.home().glob(f".pyenv/versions/{version}.*/bin/python")
        for path in (shutil.which(f"python{version}"), *map(str, installed)):
            if path and not subprocess.run([path, "-c", ""], capture_output=True, check=False).returncode:
                return path
    return None


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_another_python_prints_the_same_digest(tmp_path: Path) -> None:
    """The test uses a virtual environment without ROS."""
    other, python = other_python(), tmp_path / "venv" / "bin" / "python"
    if other is None:
        pytest.skip("there is no other supported Python here")
    subprocess.run([other, "-m", "venv", "--without-pip", tmp_path / "venv"], check=True)
    install = [sys.executable, "-m", "uv", "pip", "install", "--quiet", "--python", python]
    subprocess.run([*install, "--constraints", HOME / "requirements.lock", f"{HOME}[sim]"], check=True)
    command = ["-m", "servoloop", *SHORT]
    there, here = (
        subprocess.run([one, *command], capture_output=True, text=True, check=True, cwd=tmp_path).stdout
        for one in (python, sys.executable)
    )
    assert json.loads(there)["digest"] == json.loads(here)["digest"]


@pytest.mark.slow
def test_a_job_puts_its_cube_into_its_bin_and_reports_its_figures() -> None:
    ran = CliRunner().invoke(cli.app, ["simulate", "--job", "b", "--json"])
    assert ran.exit_code == 0, ran.output
    result = json.loads(ran.output)
    (job,) = result["jobs"]
    assert (job["grade"], job["bin"], job["success"]) == ("B", "B", True)
    assert job["message"] == "gripper opened over bin B; the arm is back at the ready pose"
    assert job["following_error"]["at_rest_rad"] <= 0.01
    assert result["faulty_cycles"] == {}


def test_a_failed_job_reports_the_reason_and_the_states_of_the_node() -> None:
    stack = SimulatedStack(build=Build(1.0, 3)).up()
    stack.run(2.5)
    stack.lines[""].faults.silence(3)
    job = run_job(stack, JobSettings(), "A")
    assert not job.success and job.bin is None
    assert "joint3: servo 3 does not respond" in job.message
    assert [state.phase for state in job.states] == [JobPhase.START, JobPhase.READY, JobPhase.ERROR]


FAULTS = "- {kind: silent, servo_id: 3, at_s: 3.0, for_s: 1.0}\n- {kind: noise, at_s: 0.5, for_s: 1.0, seed: 4}\n"


@pytest.mark.slow
def test_faults_happen_on_time(tmp_path: Path) -> None:
    script = tmp_path / "faults.yaml"
    script.write_text(FAULTS)
    once = CliRunner().invoke(cli.app, ["simulate", "--seconds", "3.5", "--faults", str(script), "--json"])
    result = json.loads(once.output)
    assert {what.split(":")[0] for what in result["faulty_cycles"]} == {"joint3"}
    assert result["faulty_cycles"]["joint3: silent"] > 15


@pytest.mark.slow
@pytest.mark.runs(COMMAND)
def test_the_command_of_the_page_sorts_three_cubes() -> None:
    ran = CliRunner().invoke(cli.app, [*shlex.split(COMMAND)[1:], "--json"])
    assert [(job["bin"], job["success"]) for job in json.loads(ran.output)["jobs"]] == [
        ("A", True),
        ("B", True),
        ("C", True),
    ]


def test_an_error_in_a_schedule_is_reported_with_its_line(tmp_path: Path) -> None:
    file = tmp_path / "schedule.yaml"
    file.write_text("seconds: -1\nfaults:\n- {kind: silence, at_s: 1.0}\n")
    with pytest.raises(ScheduleError, match=r"(?s)seconds.*faults"):
        read_schedule(file)


def test_a_fault_that_the_arm_does_not_support_is_refused_before_the_start() -> None:
    schedule = Schedule(seconds=1.0, faults=(parse("silent id=12 at=1s"),))
    with pytest.raises(FaultError, match="there is no servo 12"):
        simulate(read_files(), {"": JobSettings()}, schedule)


def test_the_exit_status_is_1_if_a_cube_is_not_in_its_bin(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sim_backend.scene.world.World.cube_bin", lambda world, joint: "C")
    ran = CliRunner().invoke(cli.app, ["simulate", "--job", "B"])
    assert ran.exit_code == 1 and "digest " in ran.output


@pytest.mark.parametrize("job", ["A,Z", "", ","])
def test_a_grade_that_the_arm_does_not_have_is_refused(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, job: str
) -> None:
    assert "expected grades separated by commas, such as A,B,C" in complaint(
        capsys, monkeypatch, "simulate", "--job", job
    )


@pytest.mark.parametrize("option", ["--seconds=inf", "--seconds=2000000", "--seconds=nan", f"--seed={2**63}"])
def test_a_duration_or_seed_out_of_range_is_refused(option: str) -> None:
    ran = CliRunner().invoke(cli.app, ["simulate", option])
    assert ran.exit_code == 2 and f"Invalid value for '{option.partition('=')[0]}'" in ran.output
