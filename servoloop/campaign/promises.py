"""The promises of a campaign: a green result means nothing for conditions that were never examined or visited."""

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
"""Makes of servos."""
CLIENTS = (JOB, *(act.model_fields["kind"].default for act in get_args(get_args(Act)[0])))
"""What clients do."""


class PromisedVisit(BaseModel):
    """A cell that must be visited. A key that is left out matches everything."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    phase: str | None = None
    fault: str | None = None
    make: str | None = None
    client: str | None = None

    @field_validator("phase")
    @classmethod
    def _known_phase(cls, phase: str | None) -> str | None:
        if phase is not None and phase not in PHASES:
            raise ValueError(f"there is no phase {phase!r}: known are {', '.join(PHASES)}")
        return phase

    @field_validator("fault")
    @classmethod
    def _known_fault(cls, fault: str | None) -> str | None:
        if fault is not None and fault not in KINDS:
            raise ValueError(f"there is no fault {fault!r}: known are {', '.join(KINDS)}")
        return fault

    @field_validator("make")
    @classmethod
    def _known_make(cls, make: str | None) -> str | None:
        if make not in (None, *MAKES):
            raise ValueError(f"there is no make {make!r}: known are {', '.join(MAKES)}")
        return make

    @field_validator("client")
    @classmethod
    def _known_client(cls, client: str | None) -> str | None:
        if client not in (None, *CLIENTS):
            raise ValueError(f"no client does {client!r}: known are {', '.join(CLIENTS)}")
        return client

    def covers(self, visit: Visit) -> bool:
        """Whether a visited cell is one of those meant."""
        wanted = (self.phase, self.fault, self.make, self.client)
        return all(name in (None, found) for name, found in zip(wanted, visit, strict=True))

    def __str__(self) -> str:
        said = [f"phase {self.phase}" if self.phase else "", f"fault {self.fault}" if self.fault else ""]
        said += [f"make {self.make}" if self.make else "", f"client {self.client}" if self.client else ""]
        return ", ".join(filter(None, said)) or "any"


class Promises(BaseModel):
    """Invariants that must have examined something, and cells that must have been visited."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    examined: tuple[str, ...] = NAMES
    """Names of invariants; by default all."""
    visits: tuple[PromisedVisit, ...] = ()

    @field_validator("examined")
    @classmethod
    def _known_invariants(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        if unknown := [name for name in names if name not in NAMES]:
            raise ValueError(f"there is no invariant {unknown[0]!r}: known are {', '.join(NAMES)}")
        return names

    def broken(self, runs: int, examined: Mapping[str, int], visits: Counter[Visit]) -> Iterator[str]:
        """Each promise that a campaign of so many runs did not keep, as a sentence."""
        for name in self.examined:
            if not examined.get(name):
                yield f"the invariant {name!r} examined nothing in {counted(runs, 'run')}"
        for promised in self.visits:
            if not any(promised.covers(visit) for visit in visits):
                yield f"no run visited {promised}, in {counted(runs, 'run')}"
