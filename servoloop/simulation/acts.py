"""Actions of simulated clients in a schedule."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from hal.plausible import Chance, Duration, NoTruth, Position, Time, VelocityScale

Share = Annotated[float, Field(ge=-1.0, le=1.0), NoTruth]


class _Act(BaseModel):
    """Action of a client, ``at_s`` seconds after the arm has become active."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    at_s: Time = 0.0


class Move(_Act):
    """Send a goal with one point for all joints, as the pick-and-place node does."""

    kind: Literal["move"] = "move"
    positions: dict[str, Position]
    seconds: Duration = 2.0


class Plan(_Act):
    """Send a planned trajectory with positions, velocities and accelerations, starting at the current command."""

    kind: Literal["plan"] = "plan"
    positions: dict[str, Position]
    scale: VelocityScale = 1.0
    """Share of the velocity limits that the planner uses."""


class Waypoints(_Act):
    """Send a goal with several points without velocities, with the joints in the order of the first point."""

    kind: Literal["waypoints"] = "waypoints"
    points: Annotated[tuple[dict[str, Position], ...], Field(min_length=1)]
    """Positions of some joints at each point. The other joints stay at their previous point."""
    seconds: Duration = 1.0
    """Time between two points."""
    delay_s: Annotated[float, Field(ge=0.0, le=10.0), NoTruth] = 0.0
    """Time from now to the stamp of the trajectory, in seconds; 0 sends no stamp."""


class Stream(_Act):
    """Stream points on a straight line to ``positions`` to the controller's topic, in every second cycle."""

    kind: Literal["stream"] = "stream"
    positions: dict[str, Position]
    for_s: Duration = 1.0


class Cancel(_Act):
    """Cancel the latest goal."""

    kind: Literal["cancel"] = "cancel"


class MoveHand(_Act):
    """Move the hand. ``share`` 0 is its lower limit and 1 its upper limit."""

    kind: Literal["hand"] = "hand"
    share: Chance = 0.5


class Switch(_Act):
    """Deactivate the arm controller, and activate it again after ``for_s``."""

    kind: Literal["switch"] = "switch"
    for_s: Duration = 0.5


class Reactivate(_Act):
    """Deactivate the hardware with its torque on. Activate it and its controllers again after ``for_s``."""

    kind: Literal["reactivate"] = "reactivate"
    for_s: Duration = 0.5


class Jog(_Act):
    """Jog one joint as with a held key in ``servoloop jog``: stream points to the topic for ``for_s``."""

    kind: Literal["jog"] = "jog"
    joint: str
    share: Share
    """Velocity as a share of the joint's limit, with its direction."""
    for_s: Duration = 1.0


class GuideArm(_Act):
    """Switch the arm to freedrive and pull at one joint. Switch back to the arm controller after ``for_s``."""

    kind: Literal["guide"] = "guide"
    joint: str
    share: Share
    """Pull as a share of the servo's full effort, with its direction."""
    for_s: Duration = 1.0


Act = Annotated[
    Move | Plan | Waypoints | Stream | Cancel | MoveHand | Switch | Reactivate | Jog | GuideArm,
    Field(discriminator="kind"),
]
