"""Measurements of an arm for the doctor's checks, and the commands that findings recommend."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from commissioning.drive_trial import TrialMotion
from drivers.servos import x
from drivers.servos.catalog import series_of
from drivers.servos.dynamixel import X
from drivers.servos.register import ServoModel
from drivers.types import ServoState
from hal.joint import Joint
from hal.robot_file.calibration_file import CalibrationFile

Heard = Literal["well", "unsteady", "broken", "late", "mute", "silent"]
"""Quality of a servo's replies.

- well: its states arrive.
- unsteady: only some of its states arrive.
- broken: all of its states arrive corrupted.
- late: its states arrive too late.
- mute: it responds to pings but does not send states.
- silent: it does not respond at all.
"""
PortProblem = Literal["missing", "denied", "busy", "not_serial", "unsuitable", "lost"]


@dataclass(frozen=True, slots=True)
class ServoSnapshot:
    """Measurements of the servo of one joint."""

    joint: Joint
    heard: Heard
    registers: Mapping[str, int] = field(default_factory=dict)
    """Register values, keyed by name, except for registers that could not be read."""
    states: tuple[ServoState, ...] = ()
    """Consecutive states at rest."""
    port: str = ""
    """Port of the servo's bus."""
    elsewhere_baud: int | None = None
    """Baud rate at which a silent servo responds, if it differs from the baud rate of the bus."""
    alone: bool = False
    """Whether the servo answers single reads but not group reads."""

    @property
    def answers(self) -> bool:
        """Whether at least one state was received."""
        return bool(self.states)

    @property
    def holds(self) -> bool:
        """Whether torque is enabled."""
        return self.registers.get("torque_enable") == 1


@dataclass(frozen=True, slots=True)
class Stranger:
    """A servo on the bus that does not belong to a joint."""

    servo_id: int
    baud: int
    model: str | None


@dataclass(frozen=True, slots=True)
class LineFigures:
    """Quality of a bus, measured with a large number of requests."""

    asked: int
    """Number of states requested."""
    lost: int
    """Number of lost replies."""
    corrupt: int
    """Number of corrupted replies."""
    late: int
    """Number of replies that arrived too late."""
    noise: int
    """Number of times that noise was received between replies."""
    round_trip_s: float | None
    """Median duration of a single read, from request to reply."""
    wire_s: float
    """Transmission time of all bytes of a single read."""
    delay_s: float = 0.0
    """Longest return delay that is set in any servo."""
    echoes: bool = False
    """Whether the adapter echoes every request."""
    cycle_s: float | None = None
    """Median time to read the states of all servos, without the goals and computations of a control cycle."""


@dataclass(frozen=True, slots=True)
class BusSnapshot:
    """Measurements of one bus. ``name`` is empty if the robot has only one bus."""

    name: str
    port: str
    baud: int
    servos: tuple[ServoSnapshot, ...] = ()
    strangers: tuple[Stranger, ...] = ()
    line: LineFigures | None = None
    problem: PortProblem | None = None
    """Port problem that prevented or ended the measurements."""
    problem_text: str = ""

    def port_option(self, port: str = "") -> str:
        """Return the command-line option for this bus at its port, or at another port."""
        return f"--port {self.name}{'=' if self.name else ''}{port or self.port}"


@dataclass(frozen=True, slots=True)
class MotionTest:
    """Result of the motion test. It is empty if the user did not request motion."""

    motions: tuple[TrialMotion, ...] = ()
    """Motions of the joints that were tested before the end of the test."""
    not_moved: str = ""
    """Reason why the joints were not moved, or why the user ended the test."""
    failed: str = ""
    """Error that ended the test after the torque had been enabled."""


@dataclass(frozen=True, slots=True)
class ArmSnapshot:
    """Measurements of the whole arm."""

    buses: tuple[BusSnapshot, ...]
    calibration: CalibrationFile | None = None
    arm: str = "NAME"
    """Name of the arm on the command line."""
    motion_test: MotionTest = MotionTest()


def counts_turns(registers: Mapping[str, int]) -> bool:
    """Return whether the registers belong to a Dynamixel X in a mode that counts turns and ignores position limits."""
    return "drive_mode" in registers and registers.get("operating_mode") in x.MODES_WITH_TURNS


def counts_at_activation(model: ServoModel, registers: Mapping[str, int], counts: int) -> int:
    """Return the counts at the start of an activation.

    When a limp Dynamixel X is activated, it discards the turns that it has counted.
    """
    if series_of(model) is not X or "homing_offset" not in registers:
        return counts
    if counts_turns(registers):
        return counts % model.counts_per_turn
    return counts if registers.get("torque_enable") else x.within_turn(counts, registers["homing_offset"])


def write(servo: ServoSnapshot, name: str, value: int) -> str:
    """Return the command that writes a register."""
    return f"servoloop register write --port {servo.port} --id {servo.joint.servo_id} {name} {value}"


def show(servo: ServoSnapshot) -> str:
    """Return the command that lists all registers."""
    return f"servoloop register list --port {servo.port} --id {servo.joint.servo_id}"


def release(servo: ServoSnapshot) -> str:
    """Return the command that disables torque."""
    return write(servo, "torque_enable", 0)


def on(port: str, verb: str, *arguments: int | str) -> str:
    """Return the command that runs a ``servoloop`` subcommand on this port."""
    return " ".join(("servoloop", verb, *map(str, arguments), "--port", port))
