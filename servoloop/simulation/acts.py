"""Actions of simulated clients, as schedules list them."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from hal.plausible import Chance, Duration, NoTruth, Position, Time, VelocityScale

Share = Annotated[float, Field(ge=-1.0, le=1.0), NoTruth]


class _Act(BaseModel):
    """One action of a client, ``at_s`` seconds after the arm is up."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    at_s: Time = 0.0


class Move(_Act):
    """A goal with one point for all joints, as the pick-and-place node sends it."""

    kind: Literal["move"] = "move"
    positions: dict[str, Position]
    seconds: Duration = 2.0


class Plan(_Act):
    """A goal as planners send it: a table of positions, velocities and accelerations from where the arm is."""

    kind: Literal["plan"] = "plan"
    positions: dict[str, Position]
    scale: VelocityScale = 1.0
    """Share of the velocity limits that the planner uses."""


class Stream(_Act):
    """Points on the controller's topic, one in each second cycle, on the straight way to ``positions``."""

    kind: Literal["stream"] = "stream"
    positions: dict[str, Position]
    for_s: Duration = 1.0


class Cancel(_Act):
    """The newest goal is canceled."""

    kind: Literal["cancel"] = "cancel"


class Hand(_Act):
    """A command for the hand; ``share`` 0 is its lower limit and 1 its upper limit."""

    kind: Literal["hand"] = "hand"
    share: Chance = 0.5


class Switch(_Act):
    """The arm's controller is deactivated, and activated again after ``for_s``."""

    kind: Literal["switch"] = "switch"
    for_s: Duration = 0.5


class Reactivate(_Act):
    """The hardware is deactivated with its torque on, and activated again after ``for_s``; then the controllers."""

    kind: Literal["reactivate"] = "reactivate"
    for_s: Duration = 0.5


class Jog(_Act):
    """One joint is turned by a held key, as ``servoloop jog`` does it: points on the topic while the key is down."""

    kind: Literal["jog"] = "jog"
    joint: str
    share: Share
    """Velocity as a share of the joint's limit, with its direction."""
    for_s: Duration = 1.0


class Guide(_Act):
    """The arm is put into freedrive, and a hand pulls at one joint until the arm's controller has the arm again."""

    kind: Literal["guide"] = "guide"
    joint: str
    share: Share
    """Pull as a share of the servo's full effort, with its direction."""
    for_s: Duration = 1.0


Act = Annotated[Move | Plan | Stream | Cancel | Hand | Switch | Reactivate | Jog | Guide, Field(discriminator="kind")]
