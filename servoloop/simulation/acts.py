"""Actions that simulated clients perform in a schedule."""

from typing import Annotated, Final, Literal

from pydantic import BaseModel, ConfigDict, Field

from hal.plausible import Duration, NoTruth, Position, Time, Tolerance, VelocityScale

Share = Annotated[float, Field(ge=-1.0, le=1.0), NoTruth]
HandShare = Annotated[float, Field(ge=0.0, le=1.0), NoTruth]


class _Act(BaseModel):
    """Action of a client, ``at_s`` seconds after the arm becomes active."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    at_s: Time = 0.0


class Move(_Act):
    """Send a goal with one point for all joints, as the pick-and-place node does."""

    kind: Literal["move"] = "move"
    positions: dict[str, Position]
    seconds: Duration = 2.0
    tolerance: Tolerance = 0.0
    """Path tolerance and goal tolerance of every joint, in rad or m, or 0 to use the controller's tolerances."""
    at_end: bool = False
    """Whether ``tolerance`` is only a goal tolerance. The path tolerances are then those of the controller."""
    goal_time_s: Annotated[float, Field(ge=0.0, le=10.0), NoTruth] = 0.0
    """Goal time tolerance in seconds, or 0 to use that of the controller."""
    mixed: bool = False
    """Whether the goal lists the joints in reverse order."""
    partial: bool = False
    """Whether the goal contains only the joints in ``positions``."""


class FollowPlan(_Act):
    """Send a planned trajectory with positions, velocities and accelerations, starting at the current command."""

    kind: Literal["plan"] = "plan"
    positions: dict[str, Position]
    scale: VelocityScale = 1.0
    """Fraction of the velocity limits that the planner uses."""
    mixed: bool = False
    """Whether the trajectory lists the joints in reverse order."""


class FollowWaypoints(_Act):
    """Send a goal with several points without velocities, with the joints in the order of the first point."""

    kind: Literal["waypoints"] = "waypoints"
    points: Annotated[tuple[dict[str, Position], ...], Field(min_length=1)]
    """Positions of some joints at each point. The other joints keep their positions from the previous point."""
    seconds: Duration = 1.0
    """Time between two points, in seconds."""
    delay_s: Annotated[float, Field(ge=0.0, le=10.0), NoTruth] = 0.0
    """Time from the action to the stamp of the trajectory, in seconds. If 0, the trajectory is sent without a stamp."""


class Stream(_Act):
    """In every second cycle, send the controller's topic a point on a straight line toward ``positions``."""

    kind: Literal["stream"] = "stream"
    positions: dict[str, Position]
    for_s: Duration = 1.0


class Cancel(_Act):
    """Cancel the latest goal."""

    kind: Literal["cancel"] = "cancel"


class MoveHand(_Act):
    """Move the hand. A ``share`` of 0 is the hand's lower limit, and 1 is its upper limit."""

    kind: Literal["hand"] = "hand"
    share: HandShare = 0.5


class Grip(_Act):
    """Send a goal to a gripper action controller, which replaces the hand's controller.

    A ``share`` of 0 is the lower limit of the hand, and 1 is its upper limit.
    """

    kind: Literal["grip"] = "grip"
    share: HandShare = 0.5
    cancel_after_s: Annotated[float, Field(ge=0.0, le=10.0), NoTruth] = 0.0
    """Time after which the goal is canceled, in seconds. If 0, the goal is not canceled."""
    speed: HandShare = 0.0
    """Speed of the fingers, as a fraction of the velocity limit. If 0, the goal contains no speed."""


class Switch(_Act):
    """Deactivate the arm controller, and reactivate it after ``for_s``."""

    kind: Literal["switch"] = "switch"
    for_s: Duration = 0.5
    hand: bool = False
    """Whether to deactivate the hand's controller instead of the arm controller."""
    impossible: bool = False
    """Whether to request, with STRICT, the activation of an unknown controller in the same switch. Such a request must
    not change anything."""


class Configure(_Act):
    """Change the parameters of the arm controller, unless a goal is active."""

    kind: Literal["configure"] = "configure"
    path_tolerance: Tolerance = 0.0
    """New path tolerance of every joint, in rad or m, or 0 to keep the path tolerances."""
    goal_tolerance: Tolerance = 0.0
    """New goal tolerance of every joint, in rad or m, or 0 to keep the goal tolerances."""
    goal_time_s: Annotated[float, Field(ge=0.0, le=10.0), NoTruth] = 0.0
    """New goal time tolerance in seconds, or 0 to keep it."""
    partial: bool = True
    """Whether to allow goals that contain only some of the joints."""


class ScaleSpeed(_Act):
    """Request a speed scaling factor from the arm controller, as ``~/speed_scaling_input`` does."""

    kind: Literal["scale_speed"] = "scale_speed"
    factor: HandShare = 1.0
    """Fraction of a path's planned speed. A factor of 0 pauses the path."""


class Reactivate(_Act):
    """Deactivate the hardware, and reactivate the hardware and the controllers after ``for_s``.

    If ``for_s`` is 0, wait until a joint is limp, and activate the hardware although it is already active. This enables
    the torque of the limp joints. A person may push limp joints by hand before the activation.
    """

    kind: Literal["reactivate"] = "reactivate"
    for_s: Time = 0.5
    relax: bool = False
    """Whether the deactivation disables the torque."""
    push: Share = 0.0
    """Effort with which a person pushes the joints, as a fraction of the maximum effort. A negative value pushes toward
    smaller positions."""


class Jog(_Act):
    """Jog one joint, as holding a key in ``servoloop jog`` does, by streaming points to the topic for ``for_s``."""

    kind: Literal["jog"] = "jog"
    joint: str
    share: Share
    """Velocity as a fraction of the joint's limit. The sign determines the direction."""
    for_s: Duration = 1.0


class GuideArm(_Act):
    """Switch the arm to freedrive and pull on one joint. Switch back to the arm controller after ``for_s``."""

    kind: Literal["guide"] = "guide"
    joint: str
    share: Share
    """Strength of the pull, as a fraction of the servo's full effort. The sign is the direction."""
    for_s: Duration = 1.0


CONNECTIONS: Final = 3
"""Maximum number of a schedule's programs that are connected to the command socket at the same time."""

STREAM_AGE_S: Final = 0.2
"""Maximum time between two targets of a stream over the command socket, in seconds."""


class SocketAct(_Act):
    """Action of a program that is connected to the command socket.

    Before an action that moves the arm, the program requests control of the arm. A program whose connection was closed
    reconnects.
    """

    connection: Annotated[int, NoTruth, Field(ge=1, le=CONNECTIONS)] = 1
    """Number of the program's connection."""


class SocketMove(SocketAct):
    """Send one motion, either as a ``move``, as a ``goal`` of the arm controller, or as one ``set_point``."""

    kind: Literal["socket_move"] = "socket_move"
    positions: dict[str, Position]
    seconds: Duration = 2.0
    op: Literal["move", "goal", "set_point"] = "move"


class SocketStream(SocketAct):
    """In each cycle, send a target or set point on a straight line toward ``positions``."""

    kind: Literal["socket_stream"] = "socket_stream"
    positions: dict[str, Position]
    for_s: Duration = 1.0
    op: Literal["targets", "set_point"] = "targets"
    leaps: bool = False
    """Whether the first target is ``positions`` itself, regardless of how far the arm is from it."""
    closes: bool = True
    """Whether the program closes the stream of targets. If False, the program only stops sending targets."""


class SocketRequest(SocketAct):
    """Send one message about control of the arm, its motions or its state.

    ``seize`` takes control of the arm by force. ``freedrive`` takes control and lets a person move the joints by hand.
    """

    kind: Literal["socket_request"] = "socket_request"
    op: Literal["take", "seize", "release", "stop", "cancel", "state", "freedrive", "freedrive_end"]


class SocketNonsense(SocketAct):
    """Send one message that the stack must reject, or bytes that are not a message."""

    kind: Literal["socket_nonsense"] = "socket_nonsense"
    fault: Literal[
        "not_json",
        "not_utf8",
        "not_an_object",
        "other_version",
        "no_version",
        "unknown_message",
        "unknown_field",
        "missing_field",
        "nan",
        "infinity",
        "unknown_joint",
        "beyond_limits",
        "too_few_positions",
        "back_in_time",
        "sent_long_ago",
        "sent_in_the_future",
        "unknown_goal",
        "too_large",
    ]


class SocketStall(SocketAct):
    """Send the first half of a message that moves the arm, and send the rest after ``for_s``.

    The program does nothing else between the two halves.
    """

    kind: Literal["socket_stall"] = "socket_stall"
    positions: dict[str, Position]
    for_s: Duration = 1.0


class SocketDeath(SocketAct):
    """Close the connection, as if the program had been killed."""

    kind: Literal["socket_death"] = "socket_death"
    half: bool = False
    """Whether the program dies in the middle of a message."""


Act = Annotated[
    Move
    | FollowPlan
    | FollowWaypoints
    | Stream
    | Cancel
    | MoveHand
    | Grip
    | Switch
    | Configure
    | ScaleSpeed
    | Reactivate
    | Jog
    | GuideArm
    | SocketMove
    | SocketStream
    | SocketRequest
    | SocketNonsense
    | SocketStall
    | SocketDeath,
    Field(discriminator="kind"),
]
