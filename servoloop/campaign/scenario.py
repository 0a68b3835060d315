"""Scenario of a campaign: the arms, the clients and the faults of its runs."""

from random import Random
from typing import Annotated, Any, Final, Literal, TypeVar

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, ValidationInfo, field_validator

from drivers.driver_errors import DriverError
from hal.plausible import Backlash, Duration, FaultCount, Time
from hal.robot_file.robot_file import ExitPolicy
from servoloop.campaign.promises import Promises
from servoloop.stack.shipped_files import OWN
from sim_backend.faults.events import KINDS


class ScenarioError(DriverError):
    """A scenario is invalid. The message lists every error with its line number."""


Item = TypeVar("Item")


def _as_list(value: Any) -> Any:
    return [value] if isinstance(value, str) else value


def _not_empty(items: tuple[Item, ...]) -> tuple[Item, ...]:
    if not items:
        raise ValueError("the list is empty: add at least one item, or remove the key")
    return items


SELDOM: Final = 0.04
"""Fraction of the runs with an arm that is listed under ``seldom``."""
OneOrMore = Annotated[tuple[Item, ...], AfterValidator(_not_empty), BeforeValidator(_as_list)]
ClientKind = Literal["job", "moves", "plans", "streams", "switches", "jogs", "guides", "grips", "sockets"]


class Scenario(BaseModel):
    """Properties that all runs of a campaign share. All other properties are drawn from the seed of each run."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    arm: OneOrMore[str] = (OWN,)
    """Names or folders of arms. Each run draws one of them."""
    seldom: Annotated[tuple[str, ...], BeforeValidator(_as_list)] = ()
    """Names or folders of arms that few runs draw instead of those in ``arm``, because their runs take longer."""
    clients: OneOrMore[ClientKind] = ("job",)
    """Kinds of clients. Each run draws one of them. ``job`` runs the jobs; the other types move the arm directly."""
    on_exit: OneOrMore[ExitPolicy] | None = None
    """Policies for what happens to the arm at the end of a run. Each run draws one of them. If None, the policy of the
    robot file applies."""
    job: Annotated[tuple[str, ...], BeforeValidator(_as_list)] = ()
    """Grades of the cubes. Each grade is one pick-and-place job."""
    seconds: Time = 0.0
    """Time the stack keeps running after its jobs, in seconds."""
    backlash_deg: Backlash = 1.0
    """Backlash of each servo, in degrees."""
    faults: FaultCount = 3
    """Number of faults in each run."""
    within_s: Duration = 10.0
    """Latest start of a fault, in seconds after the stack is up. Without jobs, it must not exceed ``seconds``."""
    kinds: OneOrMore[str] | None = None
    """Kinds of faults. If None, all kinds that are possible on the arm are used."""
    promises: Promises = Promises()
    """Conditions that the campaign must check and visits that must occur for the campaign to pass."""

    @field_validator("job")
    @classmethod
    def _done_by_a_client(cls, job: tuple[str, ...], info: ValidationInfo) -> tuple[str, ...]:
        if job and "job" not in info.data.get("clients", ("job",)):
            raise ValueError("no client runs jobs: add `job` to `clients`, or remove `job`")
        return job

    @field_validator("within_s")
    @classmethod
    def _within_the_run(cls, within_s: float, info: ValidationInfo) -> float:
        earlier = info.data
        idle = not earlier.get("job") and earlier.get("clients", ("job",)) == ("job",)
        if idle and earlier.get("faults") and within_s > earlier.get("seconds", within_s):
            raise ValueError(
                f"a run without jobs ends after {earlier['seconds']:g} s, so later faults would not happen: "
                "set `within_s` to at most `seconds`, or increase `seconds`"
            )
        return within_s

    @field_validator("kinds")
    @classmethod
    def _known_kinds(cls, kinds: tuple[str, ...] | None) -> tuple[str, ...] | None:
        if unknown := [kind for kind in kinds or () if kind not in KINDS]:
            raise ValueError(f"unknown fault {', '.join(unknown)}: choose from {', '.join(KINDS)}")
        return kinds

    @property
    def arms(self) -> tuple[str, ...]:
        """All arms, with those that few runs draw last."""
        return (*self.arm, *self.seldom)

    def arm_of(self, seed: int, usual: str) -> str:
        """Return the arm of a run: ``usual``, or seldom an arm listed under ``seldom``."""
        random = Random(f"{seed}/seldom")
        return random.choice(self.seldom) if self.seldom and random.random() < SELDOM else usual

    def place_of(self, number: int) -> tuple[str, int]:
        """Return the key and the index in the scenario file of an arm in ``arms``."""
        usual = len(self.arm)
        return ("arm", number) if number < usual else ("seldom", number - usual)
