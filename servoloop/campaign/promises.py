"""Promises of a campaign: conditions that must occur. If a condition never occurs, a passed campaign proves nothing
about it."""

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import get_args

from pydantic import BaseModel, ConfigDict, field_validator

from drivers.printable import counted
from drivers.servos.catalog import SERIES
from servoloop.campaign.invariants.watch import ALL
from servoloop.campaign.visits import JOB, NO_SERVO, PHASES, Visit
from servoloop.simulation.acts import Act
from sim_backend.faults.events import KINDS

NAMES = tuple(kind.name for kind in ALL)
MAKES = (*sorted({series.make for series in SERIES}), NO_SERVO)
"""Makes of servos that a promise may specify."""
CLIENTS = (JOB, *(act.model_fields["kind"].default for act in get_args(get_args(Act)[0])))
"""Types of client actions that a promise may specify."""


class PromisedVisit(BaseModel):
    """A visit that must occur. An omitted key matches every value."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    phase: str | None = None
    fault: str | None = None
    make: str | None = None
    client: str | None = None

    @field_validator("phase")
    @classmethod
    def _known_phase(cls, phase: str | None) -> str | None:
        if phase is not None and phase not in PHASES:
            raise ValueError(f"unknown phase {phase!r}: choose one of {', '.join(PHASES)}")
        return phase

    @field_validator("fault")
    @classmethod
    def _known_fault(cls, fault: str | None) -> str | None:
        if fault is not None and fault not in KINDS:
            raise ValueError(f"unknown fault {fault!r}: choose one of {', '.join(KINDS)}")
        return fault

    @field_validator("make")
    @classmethod
    def _known_make(cls, make: str | None) -> str | None:
        if make not in (None, *MAKES):
            raise ValueError(f"unknown make {make!r}: choose one of {', '.join(MAKES)}")
        return make

    @field_validator("client")
    @classmethod
    def _known_client(cls, client: str | None) -> str | None:
        if client not in (None, *CLIENTS):
            raise ValueError(f"unknown client action {client!r}: choose one of {', '.join(CLIENTS)}")
        return client

    def covers(self, visit: Visit) -> bool:
        """Return whether the visit matches this promise."""
        wanted = (self.phase, self.fault, self.make, self.client)
        return all(name in (None, found) for name, found in zip(wanted, visit, strict=True))

    def __str__(self) -> str:
        parts = [f"phase {self.phase}" if self.phase else "", f"fault {self.fault}" if self.fault else ""]
        parts += [f"make {self.make}" if self.make else "", f"client {self.client}" if self.client else ""]
        return ", ".join(filter(None, parts)) or "any fault"


class Promises(BaseModel):
    """Invariants whose conditions must be checked, and visits that must occur."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    examined: tuple[str, ...] = tuple(kind.name for kind in ALL if kind.promised)
    """Names of invariants. The default is all invariants except those whose conditions only some clients and arms can
    reach."""
    visits: tuple[PromisedVisit, ...] = ()

    @field_validator("examined")
    @classmethod
    def _known_invariants(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        if unknown := [name for name in names if name not in NAMES]:
            raise ValueError(f"unknown invariant {unknown[0]!r}: choose one of {', '.join(NAMES)}")
        return names

    def broken(self, runs: int, examined: Mapping[str, int], visits: Counter[Visit]) -> Iterator[str]:
        """Yield a sentence for each promise that a campaign did not keep.

        Args:
            runs: Number of runs in the campaign.
            examined: Number of times that the condition of each invariant was checked, keyed by invariant name.
            visits: Visits of all runs.
        """
        for name in self.examined:
            if not examined.get(name):
                yield f"the invariant {name!r} never examined its condition in {counted(runs, 'run')}"
        for promised in self.visits:
            if not any(promised.covers(visit) for visit in visits):
                yield f"no visit with {promised} in {counted(runs, 'run')}"
