"""What is kept of a campaign's runs: one short row each, counts, and of each invariant the first run that broke it."""

from collections import Counter
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from servoloop.campaign.campaign import Scenario, SeedReport
from servoloop.campaign.invariants import ALL, Violation

INVARIANTS = (*(kind.name for kind in ALL), "no crash")
"""All that can fall, by name."""


class Outcome(StrEnum):
    """What came of a run, the worst first."""

    FELL = "an invariant fell"
    ENDED = "ended by a lost line"
    FAILED = "a job failed"
    DONE = "as planned"


@dataclass(frozen=True, slots=True)
class Row:
    """A run in short; times in seconds of the simulation."""

    seed: int
    outcome: Outcome
    simulated_s: float
    largest_following_rad: float | None


@dataclass(slots=True)
class Tally:
    """The tally of a campaign; 20,000 runs are a few megabytes. ``planned``: how many runs were asked for."""

    scenario: Scenario
    planned: int
    rows: list[Row] = field(default_factory=list)
    violations: list[tuple[int, Violation]] = field(default_factory=list)
    """With their seeds."""
    first: dict[str, SeedReport] = field(default_factory=dict)
    """The first run that broke it, by invariant."""
    succeeded: int = 0
    """Jobs whose cube is in its bin."""
    ended: int = 0
    """Runs whose program ended early."""
    drawn: Counter[tuple[str, Outcome]] = field(default_factory=Counter)
    """Faults by kind and outcome of their run."""
    begun: Counter[tuple[int, Outcome]] = field(default_factory=Counter)
    """Faults by the second in which they began, since the arm is up, and outcome of their run."""

    def add(self, report: SeedReport) -> None:
        """Count one more run."""
        outcome = outcome_of(report)
        self.rows.append(Row(report.seed, outcome, report.simulated_s, report.largest_following_rad))
        self.succeeded += report.succeeded
        self.ended += bool(report.ended)
        for event in report.schedule.faults:
            self.drawn[event.kind, outcome] += 1
            self.begun[int(event.at_s), outcome] += 1
        for violation in report.violations:
            self.violations.append((report.seed, violation))
            self.first.setdefault(violation.invariant, report)

    @property
    def interrupted(self) -> bool:
        """Whether it ended before all runs were done."""
        return len(self.rows) < self.planned

    @property
    def simulated_s(self) -> float:
        """Of all runs."""
        return sum(row.simulated_s for row in self.rows)

    def plain(self) -> dict[str, Any]:
        """The tally for programs."""
        return {
            "runs": len(self.rows),
            "interrupted": self.interrupted,
            "simulated_s": round(self.simulated_s, 1),
            "jobs_succeeded": self.succeeded,
            "ended_early": self.ended,
            "violations": [
                {"seed": seed, "invariant": one.invariant, "time_s": one.time_s, "text": one.text}
                for seed, one in self.violations
            ],
        }


def outcome_of(report: SeedReport) -> Outcome:
    """The worst that came of a run."""
    if report.violations:
        return Outcome.FELL
    if report.ended:
        return Outcome.ENDED
    return Outcome.DONE if report.succeeded == len(report.schedule.job) else Outcome.FAILED
