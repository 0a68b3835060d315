"""Both arms of a robot run their jobs at the same time in simulated time, and the invariants watch both."""

import json
import shlex
from dataclasses import replace

import pytest
from typer.testing import CliRunner

from servoloop import cli
from servoloop.campaign.campaign import run_schedule_of
from servoloop.campaign.run import RunReport
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.schedule import Schedule
from sim_backend.faults.text import parse
from tests.pages import commands

TWO = "bimanual_so101"
(SIMULATE,) = (line for line in commands("two-arms.md") if line.startswith("servoloop simulate"))


@pytest.fixture(scope="module")
def report() -> RunReport:
    """Return the report of a run in which a servo of the right arm is silent."""
    return run_schedule_of(Schedule(arm=TWO, job=("A",), faults=(parse("silent bus=right id=3 at=4s for=0.3s"),)))


@pytest.mark.runs(SIMULATE)
def test_both_arms_sort_a_cube_at_the_same_time() -> None:
    done = CliRunner().invoke(cli.app, [*shlex.split(SIMULATE)[1:], "--json"])
    result = json.loads(done.stdout)
    jobs = result["jobs"]
    assert [(job["arm"], job["bin"], job["success"]) for job in jobs] == [("left", "A", True), ("right", "A", True)]
    assert result["simulated_s"] < 1.5 * jobs[0]["duration_s"] + 3.5 and result["missed_cycles"] == 0
    assert [*result["following_error"]] == ["left_arm_controller", "right_arm_controller"]
    for error in (*result["following_error"].values(), *(job["following_error"] for job in jobs)):
        assert 0.005 < error["largest_rad"] < 0.1


def test_fault_of_one_arm_ends_only_the_job_of_this_arm(report: RunReport) -> None:
    assert report.violations == ()
    assert (report.jobs, report.succeeded) == (2, 1)


@pytest.mark.parametrize("arm", ["left", "right"])
def test_invariants_watch_each_arm(arm: str) -> None:
    def plant(stack: FaultyStack) -> None:
        """Plant a bug: the feedback of one arm contains a wrong position."""
        controller = stack.controllers[f"{arm}_arm_controller"]._controller

        def wrong(state: object) -> None:
            if (tracking := controller.tracking) is not None:
                controller.tracking = replace(tracking, feedback_position=tracking.feedback_position + 0.1)

        stack.on_state = wrong

    found = run_schedule_of(Schedule(arm=TWO, seconds=0.3), plant).violations
    assert "feedback is true" in {violation.invariant for violation in found}
