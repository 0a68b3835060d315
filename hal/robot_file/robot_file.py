"""The robot file: which servo drives which joint, and how the arm is left. Read with the calibration beside it."""

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator

from drivers.servos.catalog import MODELS, Make, series_of
from drivers.servos.dynamixel import PROTOCOL_2, X
from hal.errors import RobotFileError
from hal.plausible import (
    Acceleration,
    Baud,
    Jerk,
    MetresPerRadian,
    NoTruth,
    Position,
    RegisterValue,
    ServoId,
    TorqueLimit,
    VelocityScale,
)
from hal.robot_file.calibration_file import CalibrationFile, calibration_path, load_calibration
from hal.robot_file.protection import protection_problems
from hal.servos.servo_settings import homing_mistake, mistakes
from hal.yaml_file import load
from hal.yaml_nodes import compose

LOG = logging.getLogger("servoloop.hal")

ExitPolicy = Literal["hold", "relax"]
BusName = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+$")]

LARGEST_IDS: dict[Make, int] = {"feetech": 253, "dynamixel": 252}


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class BusFile(_Strict):
    """The line to the servos. Which device it is, the command line says."""

    protocol: Make = "feetech"
    baud: Baud = 1_000_000


class JointFile(_Strict):
    """One joint's servo. Units: rad (m for a prismatic joint) and seconds."""

    bus: str | None = None
    """Which of the file's ``buses``; not said where there is only one."""
    servo_id: ServoId
    model: str
    sign: Annotated[Literal[1, -1], NoTruth] = 1
    zero_counts: Annotated[int, NoTruth] | None = Field(None, ge=-32767, le=32767)
    """Not said: the middle of the servo's range."""
    homing_offset: Annotated[int, NoTruth] | None = Field(None, ge=-32767, le=32767)
    """What the servo's register must hold for ``zero_counts`` to be true; not said: it is not looked at."""
    extended: bool = False
    """Whether the servo, a Dynamixel X, must be in extended position mode."""
    metres_per_radian: MetresPerRadian | None = None
    torque_limit: TorqueLimit = 1.0
    position_p: Annotated[int, NoTruth] | None = Field(None, ge=0, le=16383)
    """Dynamixel's position P gain, which lives in RAM; None leaves it as the servo has it."""
    settings: dict[str, RegisterValue] = {}
    """Registers of the servo's EEPROM, by name: gains, dead zones, protections. Written where the servo has others."""
    acceleration: Acceleration
    jerk: Jerk

    @field_validator("model")
    @classmethod
    def _known_model(cls, model: str) -> str:
        if model not in MODELS:
            raise ValueError(f"unknown model {model}: known are {', '.join(MODELS)}")
        return model


class ExitFile(_Strict):
    """The end of the torque, on virtual and on real servos."""

    virtual: ExitPolicy = "hold"
    real: ExitPolicy = "relax"

    def releases(self, virtual: bool) -> bool:
        """Return whether the torque is switched off at the end."""
        return (self.virtual if virtual else self.real) == "relax"


class ParkFile(_Strict):
    """The pose to go to before letting go, at which share of the joints' velocity limits."""

    pose: dict[str, Position]
    velocity_scale: VelocityScale = 0.25


class RobotFile(_Strict):
    """The whole file."""

    bus: BusFile | None = None
    """The short form for a robot with one line."""
    buses: Annotated[dict[BusName, BusFile], Field(min_length=1)] | None = None
    """Several lines, each with a name that the joints and the command line use."""
    joints: dict[str, JointFile]
    on_exit: ExitFile = ExitFile()
    park: ParkFile | None = None
    gravity_compensation: bool = True
    """Whether the servos' goals make up for what the servos give way under load."""
    controller_defaults: dict[str, dict[str, Any]] = {}

    def lines(self) -> dict[str, BusFile]:
        """Every bus by its name; the name of the one in the short form is empty."""
        return self.buses or {"": self.bus or BusFile()}

    def bus_of(self, joint: JointFile) -> str:
        """The name of the joint's bus."""
        return joint.bus or next(iter(self.lines()))

    def joints_on(self, bus: str) -> dict[str, JointFile]:
        """The joints whose servos are on this bus, by name."""
        return {name: joint for name, joint in self.joints.items() if self.bus_of(joint) == bus}

    @field_validator("buses")
    @classmethod
    def _one_form(cls, buses: dict[str, BusFile] | None, info: ValidationInfo) -> dict[str, BusFile] | None:
        if info.data.get("bus", "with mistakes") is not None:
            raise ValueError("the file has bus and buses: list every bus under buses, and take bus out")
        if buses and "world" in buses:
            raise ValueError("no bus may be called world: PORT.world is where an emulator shows its world")
        return buses

    @field_validator("joints")
    @classmethod
    def _fit_together(cls, joints: dict[str, JointFile], info: ValidationInfo) -> dict[str, JointFile]:
        buses = info.data.get("buses") or {}
        # Who names no bus is on the only one.
        home = next(iter(buses)) if len(buses) == 1 else None
        placed = {name: joint.model_copy(update={"bus": joint.bus or home}) for name, joint in joints.items()}
        problems = _doubles(placed) + _babel(placed)
        if "bus" in info.data and "buses" in info.data:  # else their own mistakes come first
            problems += _misplaced(joints, info.data["bus"], info.data["buses"])
        if problems:
            raise ValueError("; ".join(problems))
        return joints

    @field_validator("park")
    @classmethod
    def _known_joints(cls, park: ParkFile | None, info: ValidationInfo) -> ParkFile | None:
        if park and "joints" in info.data:
            unknown = park.pose.keys() - info.data["joints"].keys()
            if unknown:
                raise ValueError(f"pose names unknown joints: {', '.join(sorted(unknown))}")
        return park


def _doubles(joints: Mapping[str, JointFile]) -> list[str]:
    """Servos that two joints lay claim to."""
    owners: dict[tuple[str | None, int], str] = {}
    problems: list[str] = []
    for name, joint in joints.items():
        other = owners.setdefault((joint.bus, joint.servo_id), name)
        if other != name:
            where = f" on bus {joint.bus}" if joint.bus else ""
            problems.append(f"{other} and {name} both have servo_id {joint.servo_id}{where}")
    return problems


def _misplaced(
    joints: Mapping[str, JointFile], single: BusFile | None, several: Mapping[str, BusFile] | None
) -> list[str]:
    """Joints on no bus or on the wrong one, and buses without a joint."""
    buses = several or {}
    problems: list[str] = []
    for name, joint in joints.items():
        if joint.bus is None and len(buses) > 1:
            problems.append(f"{name} needs bus: one of {', '.join(buses)}")
        elif joint.bus is not None and not buses:
            problems.append(f"{name} names bus {joint.bus}, but the file has no buses: take it out, or list it there")
        elif joint.bus is not None and joint.bus not in buses:
            problems.append(f"{name} names bus {joint.bus}, which is not among {', '.join(buses)}")
        else:
            bus = buses[joint.bus] if joint.bus else next(iter(buses.values()), single or BusFile())
            problems += _misfits(name, joint, bus.protocol)
    used = {joint.bus for joint in joints.values()}
    problems += [f"no joint is on bus {bus}" for bus in buses if len(buses) > 1 and bus not in used]
    return problems


def _misfits(name: str, joint: JointFile, protocol: Make) -> list[str]:
    """The settings that one joint's servo asks for and its bus does not have."""
    problems: list[str] = []
    model = MODELS[joint.model]
    if series_of(model).make != protocol:
        problems.append(f"{name} has model {joint.model}, which does not speak the bus's protocol, {protocol}")
    if joint.servo_id > LARGEST_IDS[protocol]:
        problems.append(f"{name} has servo_id {joint.servo_id}, and {protocol} has IDs up to {LARGEST_IDS[protocol]}")
    if joint.position_p is not None and series_of(model).protocol is not PROTOCOL_2:
        problems.append(f"{name} has position_p, which only dynamixel servos of protocol 2.0 take from here")
    if wrong := homing_mistake(model, joint.homing_offset):
        problems.append(f"{name}: {wrong}")
    if joint.extended and series_of(model) is not X:
        problems.append(f"{name}: a {joint.model} has no extended position mode: take `extended` out")
    problems += [f"{name}.settings: {mistake}" for mistake in mistakes(model, joint.settings)]
    return problems


def _babel(joints: Mapping[str, JointFile]) -> list[str]:
    """Servos of one make that cannot share a bus, because they speak differently."""
    spoken: dict[tuple[str | None, Make], dict[str, str]] = {}
    for name, joint in joints.items():
        model = MODELS[joint.model]
        spoken.setdefault((joint.bus, series_of(model).make), {}).setdefault(series_of(model).protocol.name, name)
    return [
        f"{' and '.join(first.values())} cannot share a bus, they speak {' and '.join(first)}: "
        "give each a line of its own under buses"
        for first in spoken.values()
        if len(first) > 1
    ]


def load_robot_file(path: Path) -> RobotFile:
    """Read the robot file and the calibration beside it. Raises RobotFileError with every mistake, file and line.

    Protections of servos that cannot act are named in the log.
    """
    file, calibration = load(path, RobotFile, RobotFileError), load_calibration(path)
    for problem in unprotected(file):
        LOG.warning("%s: %s", path, problem)
    return file if calibration is None else _calibrated(file, calibration, calibration_path(path))


def unprotected(file: RobotFile) -> list[str]:
    """The protections of the file's servos that cannot act, each with its joint and the remedy."""
    return [
        f"{name}: {problem}"
        for name, joint in file.joints.items()
        for problem in protection_problems(MODELS[joint.model], joint.torque_limit, joint.settings)
    ]


def _calibrated(file: RobotFile, calibration: CalibrationFile, path: Path) -> RobotFile:
    """The robot file with what calibration found. One that is not of this robot is refused."""
    problems: list[str] = []
    joints, source = dict(file.joints), compose(path, RobotFileError)
    for name, found in calibration.joints.items():
        place = source.place(("joints", name))
        joint = joints.get(name)
        if joint is None or joint.servo_id != found.servo_id:
            has = "no such joint" if joint is None else f"servo {joint.servo_id} there"
            problems.append(f"{place}: {name} was calibrated with servo {found.servo_id}, and the robot file has {has}")
            continue
        if wrong := homing_mistake(MODELS[joint.model], found.homing_offset):
            problems.append(f"{place}: {name}: {wrong}")
        if found.extended and series_of(MODELS[joint.model]) is not X:
            problems.append(f"{place}: {name}: a {joint.model} has no extended position mode: take `extended` out")
        update = found.model_dump(include={"sign", "zero_counts", "homing_offset", "extended"})
        joints[name] = joint.model_copy(update=update)
    if problems:
        raise RobotFileError("\n".join([*problems, "calibrate again, or take the calibration file away"]))
    return file.model_copy(update={"joints": joints})
