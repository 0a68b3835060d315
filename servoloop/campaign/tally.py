"""What is kept of a campaign's runs: one short row each, counts, and of each invariant the first run that broke it."""

from collections import Counter
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from servoloop.campaign.campaign import Scenario
from servoloop.campaign.invariants.watch import ALL, Violation
from servoloop.campaign.run import WHOLE_RUN, RunReport
from servoloop.campaign.visits import PHASES, Visit

EXAMINED = tuple(kind.name for kind in ALL)
"""Invariants, which count what they examine, by name."""
INVARIANTS = (*EXAMINED, *WHOLE_RUN)
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
    first: dict[str, RunReport] = field(default_factory=dict)
    """The first run that broke it, by invariant."""
    jobs: int = 0
    """Jobs of all runs."""
    succeeded: int = 0
    """Jobs whose cube is in its bin."""
    ended: int = 0
    """Runs whose program ended early."""
    drawn: Counter[tuple[str, Outcome]] = field(default_factory=Counter)
    """Faults by kind and outcome of their run."""
    begun: Counter[tuple[int, Outcome]] = field(default_factory=Counter)
    """Faults by the second in which they began, since the arm is up, and outcome of their run."""

    examined: Counter[str] = field(default_factory=Counter)
    """How often each invariant looked at its condition, by name."""
    visits: Counter[Visit] = field(default_factory=Counter)
    """Cycles, by what was wrong in which phase."""

    def add(self, report: RunReport) -> None:
        """Count one more run."""
        outcome = outcome_of(report)
        self.rows.append(Row(report.seed, outcome, report.simulated_s, report.largest_following_rad))
        self.jobs += len(report.schedule.job)
        self.succeeded += report.succeeded
        self.ended += bool(report.ended)
        for event in report.schedule.faults:
            self.drawn[event.kind, outcome] += 1
            if event.since == "up":
                self.begun[int(event.at_s), outcome] += 1
        self.examined.update(report.examined)
        self.visits.update(report.visits)
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

    @property
    def broken_promises(self) -> list[str]:
        """What the scenario promises to look at and the campaign did not, in sentences; none if it was interrupted."""
        if self.interrupted:
            return []
        return list(self.scenario.promises.broken(len(self.rows), self.examined, self.visits))

    @property
    def marks(self) -> list[tuple[str, int, int]]:
        """Each invariant with how often it examined its condition, and how many runs violate it."""
        runs = Counter(one.invariant for _, one in self.violations)
        return [(name, self.examined[name], runs[name]) for name in EXAMINED]

    @property
    def phases(self) -> tuple[str, ...]:
        """The phases of a run."""
        return PHASES

    @property
    def visits_by_phase(self) -> list[tuple[str, list[int]]]:
        """Each fault that was there, with the cycles in each phase."""
        cycles = Counter[tuple[str, str]]()
        for visit, count in self.visits.items():
            cycles[visit.fault, visit.phase] += count
        return [(fault, [cycles[fault, phase] for phase in PHASES]) for fault in sorted({fault for fault, _ in cycles})]

    def plain(self) -> dict[str, Any]:
        """The tally for programs."""
        return {
            "runs": len(self.rows),
            "interrupted": self.interrupted,
            "simulated_s": round(self.simulated_s, 1),
            "jobs_succeeded": self.succeeded,
            "ended_early": self.ended,
            "examined": {name: self.examined[name] for name in EXAMINED},
            "visits": [{**cell._asdict(), "cycles": cycles} for cell, cycles in sorted(self.visits.items())],
            "broken_promises": self.broken_promises,
            "violations": [
                {"seed": seed, "invariant": one.invariant, "time_s": one.time_s, "text": one.text}
                for seed, one in self.violations
            ],
        }


def outcome_of(report: RunReport) -> Outcome:
    """The worst that came of a run."""
    if report.violations:
        return Outcome.FELL
    if report.ended:
        return Outcome.ENDED
    return Outcome.DONE if report.succeeded == len(report.schedule.job) else Outcome.FAILED
