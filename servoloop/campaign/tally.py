"""Collect the results of a campaign: a short row for each run, counts, and the first violation of each invariant."""

from collections import Counter
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from servoloop.campaign.invariants import Violation
from servoloop.campaign.invariants.watch import ALL
from servoloop.campaign.run import WHOLE_RUN, RunReport
from servoloop.campaign.scenario import Scenario
from servoloop.campaign.visits import PHASES, Visit

EXAMINED = tuple(kind.name for kind in ALL)
"""Names of the invariants that count how often their condition is checked."""
INVARIANTS = (*EXAMINED, *WHOLE_RUN)
"""Names of all invariants that a run can violate."""


class RunOutcome(StrEnum):
    """Outcome of a run, from worst to best."""

    VIOLATED = "violated an invariant"
    ENDED = "ended early"
    FAILED = "failed a job"
    DONE = "as planned"


@dataclass(frozen=True, slots=True)
class RunRow:
    """Summary of a run."""

    seed: int
    outcome: RunOutcome
    simulated_s: float
    largest_following_rad: float | None


@dataclass(slots=True)
class Tally:
    """Results of a campaign's runs. The results of 20,000 runs take up a few megabytes."""

    scenario: Scenario
    planned: int
    """Planned number of runs in the campaign."""
    rows: list[RunRow] = field(default_factory=list)
    violations: list[tuple[int, Violation]] = field(default_factory=list)
    """Violations, each with the seed of its run."""
    first: dict[str, RunReport] = field(default_factory=dict)
    """First run that violates each invariant, keyed by invariant name."""
    jobs: int = 0
    """Number of jobs in all runs."""
    succeeded: int = 0
    """Number of jobs that put their cube into its bin."""
    ended: int = 0
    """Number of runs whose program ended early."""
    drawn: Counter[tuple[str, RunOutcome]] = field(default_factory=Counter)
    """Number of faults, by fault type and outcome of the run."""
    begun: Counter[tuple[int, RunOutcome]] = field(default_factory=Counter)
    """Number of faults, by start time (whole seconds since the stack was up) and outcome of the run."""
    examined: Counter[str] = field(default_factory=Counter)
    """Number of times that each invariant examined its condition, keyed by invariant name."""
    visits: Counter[Visit] = field(default_factory=Counter)
    """Number of cycles in which each fault was active, by phase, make and client."""

    def add(self, report: RunReport) -> None:
        """Add the report of a run."""
        outcome = outcome_of(report)
        self.rows.append(RunRow(report.seed, outcome, report.simulated_s, report.largest_following_rad))
        self.jobs += report.jobs
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
        """Whether the campaign ended before all runs were completed."""
        return len(self.rows) < self.planned

    @property
    def simulated_s(self) -> float:
        """Simulated time of all runs, in seconds."""
        return sum(row.simulated_s for row in self.rows)

    @property
    def broken_promises(self) -> list[str]:
        """The promises that the campaign did not keep, as sentences. An interrupted campaign does not break any
        promises."""
        if self.interrupted:
            return []
        return list(self.scenario.promises.broken(len(self.rows), self.examined, self.visits))

    @property
    def marks(self) -> list[tuple[str, int, int]]:
        """Name of each invariant, number of times its condition was checked, and number of runs that violate it."""
        runs = Counter(one.invariant for _, one in self.violations)
        return [(name, self.examined[name], runs[name]) for name in EXAMINED]

    @property
    def phases(self) -> tuple[str, ...]:
        """The phases of a run, in the order used in the table of visits."""
        return PHASES

    @property
    def visits_by_phase(self) -> list[tuple[str, list[int]]]:
        """Each fault that occurred, with the number of cycles it was active in each phase."""
        cycles = Counter[tuple[str, str]]()
        for visit, count in self.visits.items():
            cycles[visit.fault, visit.phase] += count
        return [(fault, [cycles[fault, phase] for phase in PHASES]) for fault in sorted({fault for fault, _ in cycles})]

    def plain(self) -> dict[str, Any]:
        """Return the tally as it is printed with ``--json``."""
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


def outcome_of(report: RunReport) -> RunOutcome:
    """Return the worst outcome that applies to a run."""
    if report.violations:
        return RunOutcome.VIOLATED
    if report.ended:
        return RunOutcome.ENDED
    return RunOutcome.DONE if report.succeeded == report.jobs else RunOutcome.FAILED
