"""A campaign with the default scenario finds planted bugs, minimizes the schedules and names the invariants."""

from pathlib import Path

import pytest

from servoloop.campaign.campaign import read_scenario, run_schedule_of, run_seed
from servoloop.campaign.kept_violation import violates
from servoloop.campaign.run import RunReport
from servoloop.campaign.shrink import shrink
from tests.servoloop.planted_bugs import BUGS

SCENARIO = read_scenario(Path(__file__).parents[2] / "docs" / "campaign.yaml")
SEEDS = 300
FIRST = {
    "controllers_do_not_relieve_joints_that_they_take_over": 4500,
    "isolated_faults_add_up": 1000,
    "joints_that_return_over_their_seam_are_one_turn_off": 700,
    "rejected_positions_confirm_later_positions": 20200,
}
"""First seeds for rare bugs that are not found within ``SEEDS`` from 0 on. See the table in docs/campaigns.md."""


def first_that_finds(invariants: frozenset[str], first: int) -> tuple[RunReport, str]:
    """Return the first run that violates one of these invariants, and the invariant."""
    for seed in range(first, first + SEEDS):
        report = run_seed(SCENARIO, seed)
        found = sorted(invariants & {violation.invariant for violation in report.violations})
        if found:
            return report, found[0]
    raise AssertionError(f"{SEEDS} seeds from {first} on violate none of {sorted(invariants)}")


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("name", BUGS)
def test_a_campaign_finds_the_bug_names_it_and_minimizes_the_schedule(
    monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    plant, invariants = BUGS[name]
    plant(monkeypatch)
    report, invariant = first_that_finds(invariants, FIRST.get(name, 0))
    smallest = shrink(report.schedule, lambda schedule: violates(schedule, invariant))
    assert len(smallest.faults) <= 2 and len(smallest.clients) <= 4
    monkeypatch.undo()
    assert run_schedule_of(smallest).violations == (), "the invariant is violated without the bug too"
