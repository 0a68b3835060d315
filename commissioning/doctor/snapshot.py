"""A snapshot is all that was measured of an arm; what it means, the checks decide."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from commissioning.drive_trial import JointMotion
from drivers.bus.types import ServoState
from hal.joint import Joint
from hal.robot_file.calibration_file import CalibrationFile

Heard = Literal["well", "unsteady", "broken", "late", "mute", "silent"]
"""States in one piece; only now and then; never in one piece; only too late; pings but no state; nothing."""
PortProblem = Literal["missing", "denied", "busy", "not_serial", "unsuitable", "lost"]


@dataclass(frozen=True, slots=True)
class ServoSnapshot:
    """One joint's servo. ``registers`` by name: what could not be read is absent."""

    joint: Joint
    heard: Heard
    registers: Mapping[str, int] = field(default_factory=dict)
    states: tuple[ServoState, ...] = ()
    """At rest, one after the other."""
    port: str = ""
    """The port of its bus."""
    elsewhere_baud: int | None = None
    """A silent one's rate, where it answers at another than the bus's."""

    @property
    def answers(self) -> bool:
        """Whether anything is known of it."""
        return bool(self.states)

    @property
    def holds(self) -> bool:
        """Whether it drives its motor."""
        return self.registers.get("torque_enable") == 1


@dataclass(frozen=True, slots=True)
class Stranger:
    """A servo on the line that no joint has."""

    servo_id: int
    baud: int
    model: str | None


@dataclass(frozen=True, slots=True)
class LineFigures:
    """The line over many questions. The shares are of ``asked`` states; times are of single reads."""

    asked: int
    lost: int
    corrupt: int
    late: int
    noise: int
    """Pieces of garbage between replies."""
    round_trip_s: float | None
    """The median, from question to answer."""
    wire_s: float
    """How long its bytes are on the wire."""
    delay_s: float = 0.0
    """The longest return delay that a servo was set to."""
    echoes: bool = False


@dataclass(frozen=True, slots=True)
class BusSnapshot:
    """One line. Its name is empty where the robot has only one."""

    name: str
    port: str
    baud: int
    servos: tuple[ServoSnapshot, ...] = ()
    strangers: tuple[Stranger, ...] = ()
    line: LineFigures | None = None
    problem: PortProblem | None = None
    """Why nothing could be measured, or no more."""
    problem_text: str = ""


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The whole arm."""

    buses: tuple[BusSnapshot, ...]
    calibration: CalibrationFile | None = None
    arm: str = "NAME"
    """What the arm is called on the command line."""
    motions: tuple[JointMotion, ...] = ()
    not_moved: str = ""
    """Why the joints were not moved although that was asked for."""


def write(servo: ServoSnapshot, name: str, value: int) -> str:
    """Write one register."""
    return f"servoloop register write --port {servo.port} --id {servo.joint.servo_id} {name} {value}"


def show(servo: ServoSnapshot) -> str:
    """Show the whole table."""
    return f"servoloop register list --port {servo.port} --id {servo.joint.servo_id}"


def let_go(servo: ServoSnapshot) -> str:
    """Switch its torque off."""
    return write(servo, "torque_enable", 0)


def on(port: str, verb: str, *arguments: int | str) -> str:
    """A verb for one servo."""
    return " ".join(("servoloop", verb, *map(str, arguments), "--port", port))
