"""``servoloop simulate``: the node's job on simulated time, and the same digest wherever the same is run."""

import json
import subprocess
import sys

import pytest
from typer.testing import CliRunner

from nodes.pick_place.job import Phase
from nodes.pick_place.settings import Settings
from servoloop import cli
from servoloop.files import read_files
from servoloop.simulation.job import run_job
from servoloop.simulation.simulate import simulate
from servoloop.simulation.stack import SimulatedStack
from sim_backend.build import Build
from tests.complaint import complaint

SHORT = ["simulate", "--seed", "1", "--seconds", "1.5", "--json"]


def test_two_processes_print_the_same_digest_and_another_arm_another_one() -> None:
    once = subprocess.run([sys.executable, "-m", "servoloop", *SHORT], capture_output=True, text=True, check=True)
    here = simulate(read_files(), Settings(), Build(1.0, 1), seconds=1.5)
    other = simulate(read_files(), Settings(), Build(1.0, 2), seconds=1.5)
    assert json.loads(once.stdout)["digest"] == here.digest != other.digest
    assert here.cycles == pytest.approx(4.0 * 20, abs=2) and here.missed_cycles == 0


def test_a_job_brings_its_cube_home_and_says_how_well_it_went() -> None:
    ran = CliRunner().invoke(cli.app, ["simulate", "--job", "b", "--json"])
    assert ran.exit_code == 0, ran.output
    result = json.loads(ran.output)
    (job,) = result["jobs"]
    assert (job["grade"], job["bin"], job["success"]) == ("B", "B", True)
    assert job["message"] == "let go over bin B; the arm is back at ready"
    assert job["following_error"]["at_rest_rad"] <= 0.01
    assert result["faulty_cycles"] == {}


def test_a_job_that_fails_says_why_and_its_states_are_the_nodes() -> None:
    stack = SimulatedStack(build=Build(1.0, 3)).up()
    stack.run(2.5)
    stack.lines[""].faults.silence(3)
    job = run_job(stack, Settings(), "A")
    assert not job.success and job.bin is None
    assert "joint3: servo 3 does not answer" in job.message
    assert [state.phase for state in job.states] == [Phase.START, Phase.READY, Phase.ERROR]


def test_it_ends_with_1_where_a_cube_is_not_in_its_bin(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sim_backend.world.World.cube_bin", lambda world: "C")
    ran = CliRunner().invoke(cli.app, ["simulate", "--job", "B"])
    assert ran.exit_code == 1 and "digest " in ran.output


@pytest.mark.parametrize("job", ["A,Z", "", ","])
def test_a_grade_that_the_arm_does_not_know_is_refused(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, job: str
) -> None:
    assert "--job takes grades of A, B, C" in complaint(capsys, monkeypatch, "simulate", "--job", job)
