"""Define and check the messages of the command socket: one JSON object per line, with the protocol version."""

import json
import math
from collections.abc import Mapping
from typing import Annotated, Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError
from pydantic_core import from_json

from hal.plausible import AnyAcceleration, AnyVelocity, ClockTime, Duration, NoTruth, Position, Rate, Seed, Speed, Time
from hal.yaml_file import error_text
from servoloop.command_socket.command_errors import CommandError

VERSION: Final = 1
"""Protocol version. The version changes whenever an older client would misunderstand a message."""
MAX_LINE_BYTES: Final = 500_000
"""Maximum size of a message, in bytes. This size allows a goal with 5000 points of six joints."""
LONGEST_TEXT: Final = 500
"""Maximum length of a name in a message, in characters."""

Text = Annotated[str, Field(max_length=LONGEST_TEXT)]
Number = Seed
"""Number of a message, a goal or a motion."""


class Message(BaseModel):
    """Fields of every message to the stack."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    v: Annotated[int, NoTruth, Field(ge=VERSION, le=VERSION)]
    id: Number | Text
    """Identifier of the message, a number or a string, which is repeated in the reply."""


class Hello(Message):
    """Request for the description of the arm."""

    op: Literal["hello"]
    client: Text = ""
    """Name of the client, used in messages to other clients."""


class GetState(Message):
    """Request for the latest state."""

    op: Literal["state"]


class WatchStates(Message):
    """Request for a state event after each cycle, at most ``rate_hz`` times a second. If the rate is 0, the events
    stop."""

    op: Literal["watch"]
    rate_hz: Rate


class ListControllers(Message):
    """Request for the list of controllers."""

    op: Literal["controllers"]


class Take(Message):
    """Request for control of the arm. ``force`` takes control away from another client, whose motions then stop."""

    op: Literal["take"]
    force: bool = False


class Release(Message):
    """Request to release control of the arm. Motions of this client stop."""

    op: Literal["release"]


class MotionMessage(Message):
    """Message that moves joints. The stack rejects the message if it is too old."""

    sent_s: ClockTime
    """Time at which the message was sent, on CLOCK_MONOTONIC of this machine, in seconds."""


class Point(BaseModel):
    """Point of a trajectory, in the goal's joint order: positions in rad or m, velocities in rad/s or m/s, and seconds
    from the start."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    positions: list[Position]
    velocities: list[AnyVelocity] = []
    accelerations: list[AnyAcceleration] = []
    time_s: Time


class SendGoal(MotionMessage):
    """Goal of a trajectory controller. The result arrives as an event."""

    op: Literal["goal"]
    controller: Text = ""
    """Name of the controller. If empty, the active trajectory controller that moves these joints is used."""
    joints: list[Text]
    points: list[Point]


class SendGrip(MotionMessage):
    """Goal of a gripper controller, in rad or m. The result arrives as an event."""

    op: Literal["grip"]
    controller: Text = ""
    """Name of the controller. If empty, the only active gripper controller is used."""
    position: Position
    velocity: Speed = 0.0
    """Maximum velocity, in rad/s or m/s. If 0, the controller's default velocity is used."""


class SendSetPoint(MotionMessage):
    """Set point of a forward or trajectory controller, as part of a stream."""

    op: Literal["set_point"]
    controller: Text
    values: Annotated[list[AnyVelocity], Field(min_length=1)]
    """One value for each joint of the controller, in the controller's joint order."""
    time_s: Duration = 0.3
    """Time until a trajectory controller comes to rest at the set point, in seconds. Forward controllers ignore this
    value."""


class CancelGoal(Message):
    """Request to cancel a goal of this client."""

    op: Literal["cancel"]
    goal: Number


class Stop(Message):
    """Request to cancel all goals and stop all streams of all clients, including ROS clients.

    Every client may send this request.
    """

    op: Literal["stop"]


class SwitchControllers(Message):
    """Request to activate and deactivate controllers in one cycle."""

    op: Literal["switch"]
    activate: list[Text] = []
    deactivate: list[Text] = []


class DescribeArm(Message):
    """Request for the joints, limits and gripper of the arm."""

    op: Literal["arm"]


class MoveJoints(MotionMessage):
    """Motion of some joints of the arm, regardless of which controllers move them.

    The result arrives as an event.
    """

    op: Literal["move"]
    joints: list[Text]
    times_s: list[Time]
    positions: list[list[Position]]
    velocities: list[list[AnyVelocity]] = []


class CancelMove(Message):
    """Request to cancel a motion of this client."""

    op: Literal["cancel_move"]
    motion: Number


class OpenStream(Message):
    """Request to open a stream of targets. The stream ends if no target arrives for ``max_age_s``."""

    op: Literal["stream"]
    max_age_s: Duration


class SendTargets(MotionMessage):
    """Next targets of the stream, keyed by joint name. Joints without a target hold their last target."""

    op: Literal["targets"]
    positions: dict[str, Position]


class CloseStream(Message):
    """Request to end the stream of this client."""

    op: Literal["stream_end"]


class Torque(Message):
    """Request to enable the torque of all servos, or to move to the robot file's park pose and disable the torque."""

    op: Literal["torque"]
    on: bool
    park: bool = True


class SetFreedrive(Message):
    """Request to let a person move the joints by hand, or to make the joints hold their positions again."""

    op: Literal["freedrive"]
    on: bool


class Record(Message):
    """Request to start a recording. ``path`` is absolute."""

    op: Literal["record"]
    path: str


class EndRecord(Message):
    """Request to end a recording that was started by a client."""

    op: Literal["record_end"]
    path: str


AnyMessage = (
    *(Hello, GetState, WatchStates, ListControllers, Take, Release, SendGoal, SendGrip, SendSetPoint),
    *(DescribeArm, MoveJoints, CancelMove, OpenStream, SendTargets, CloseStream, Torque, SetFreedrive),
    *(CancelGoal, Stop, SwitchControllers, Record, EndRecord),
)
"""Classes of all messages to the stack."""
OPS: Final = tuple(kind.model_fields["op"].annotation.__args__[0] for kind in AnyMessage)  # type: ignore[union-attr]
"""Names of all messages, in the order of ``AnyMessage``."""
_ADAPTERS: Final[Mapping[str, TypeAdapter[Any]]] = {
    op: TypeAdapter(kind) for op, kind in zip(OPS, AnyMessage, strict=True)
}


def identity(line: bytes) -> int | str | None:
    """Return the ID of a message that is otherwise invalid, if it has one."""
    try:
        found = from_json(line).get("id")
    except (ValueError, AttributeError):
        return None
    return found if isinstance(found, int | str) else None


def parse(line: bytes) -> Message:
    """Parse and check a message. Raises CommandError of type ``malformed`` or ``version``."""
    try:
        found = from_json(line, allow_inf_nan=False)
    except ValueError as error:
        raise CommandError("malformed", f"the message is not JSON ({error}): send one object per line") from None
    if not isinstance(found, dict):
        raise CommandError("malformed", "the message is not a JSON object: send one object per line")
    if found.get("v") != VERSION:
        text = f"the message has version {found.get('v')!r}: this stack uses version {VERSION}"
        raise CommandError("version", text)
    adapter = _ADAPTERS.get(op) if isinstance(op := found.get("op"), str) else None
    if adapter is None:
        raise CommandError("malformed", f"op is {str(op)[:LONGEST_TEXT]!r}: use one of {', '.join(OPS)}")
    try:
        message: Message = adapter.validate_python(found)
        return message
    except ValidationError as error:
        mistake = _mistake(error)
    raise CommandError("malformed", f"{op}: {mistake}")


def _mistake(error: ValidationError) -> str:
    """Describe the first error. Its details refer to the frame of ``parse``, so that frame must not keep them."""
    first = error.errors(include_url=False)[0]
    # For a field with several types, such as id, pydantic also names the validator.
    place = ".".join(str(part) for part in first["loc"] if "[" not in str(part))
    return f"{place}: {error_text(first)}"


def encode(fields: Mapping[str, Any]) -> bytes:
    """Return a message as one line, including the protocol version. Values that are not finite are written as null."""
    return json.dumps({"v": VERSION, **finite(fields)}, allow_nan=False, separators=(",", ":")).encode() + b"\n"


def finite(value: Any) -> Any:
    """Return a message value with None in place of NaN and infinity."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: finite(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [finite(part) for part in value]
    return value
