"""Read the robot file, which assigns a servo to each joint and specifies what happens to the torque at exit.

The calibration file in the same folder is also read.
"""

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator

from drivers.servos.catalog import MODELS, Make, model_advice, series_of, too_many
from drivers.servos.dynamixel import PROTOCOL_2, X
from drivers.servos.register import ServoModel
from hal.hal_errors import RobotFileError
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
from hal.robot_file.servo_models import load_servo_models
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
    """Protocol and baud rate of a bus. The device is set on the command line."""

    protocol: Make = "feetech"
    baud: Baud = 1_000_000


FirmwareVersion = Annotated[int, NoTruth, Field(ge=1, le=254)]
"""Firmware version, as reported by a servo."""


class JointFile(_Strict):
    """Servo of one joint. Units are rad (m for a prismatic joint) and s."""

    bus: str | None = None
    """Name of the bus in ``buses``; may be omitted if there is only one bus."""
    servo_id: ServoId
    model: str
    sign: Annotated[Literal[1, -1], NoTruth] = 1
    zero_counts: Annotated[int, NoTruth] | None = Field(None, ge=-32767, le=32767)
    """Counts at joint position 0; by default the middle of the servo's range."""
    homing_offset: Annotated[int, NoTruth] | None = Field(None, ge=-32767, le=32767)
    """Homing offset that the servo must have for ``zero_counts`` to be valid; not checked if omitted."""
    extended: bool = False
    """Whether the servo, a Dynamixel X, must be in extended position mode."""
    metres_per_radian: MetresPerRadian | None = None
    torque_limit: TorqueLimit = 1.0
    position_p: Annotated[int, NoTruth] | None = Field(None, ge=0, le=16383)
    """Position P gain of a Dynamixel servo, which keeps the gain in RAM. If None, activation writes the factory value,
    if known."""
    firmware: FirmwareVersion | None = None
    """Firmware version of the virtual servo, a Dynamixel X; by default the usual version. Real servos ignore this
    value.
    """
    settings: dict[str, RegisterValue] = {}
    """Values of EEPROM registers (gains, dead zones, protections), keyed by register name. Values that differ from
    those stored in the servo are written.
    """
    acceleration: Acceleration
    jerk: Jerk

    @field_validator("model")
    @classmethod
    def _known_model(cls, model: str) -> str:
        if model not in MODELS:
            raise ValueError(f"unknown model {model}: {model_advice(model)}")
        return model


class ExitFile(_Strict):
    """What happens to the torque at exit, for virtual and real servos."""

    virtual: ExitPolicy = "hold"
    real: ExitPolicy = "relax"

    def releases(self, virtual: bool) -> bool:
        """Return whether the torque is disabled at exit."""
        return (self.virtual if virtual else self.real) == "relax"


class ParkFile(_Strict):
    """Pose to which the arm moves before its torque is disabled."""

    pose: dict[str, Position]
    """Joint positions, in rad or m."""
    velocity_scale: VelocityScale = 0.25
    """Speed of the motion, as a fraction of the velocity limits."""


class RobotFile(_Strict):
    """Content of the robot file."""

    bus: BusFile | None = None
    """Bus of a robot that has only one bus (short form of ``buses``)."""
    buses: Annotated[dict[BusName, BusFile], Field(min_length=1)] | None = None
    """Buses, keyed by name. Joints and the command line refer to these names."""
    joints: dict[str, JointFile]
    on_exit: ExitFile = ExitFile()
    park: ParkFile | None = None
    gravity_compensation: bool = True
    """Whether goals compensate for the compliance of the servos under load."""
    controller_defaults: dict[str, dict[str, Any]] = {}

    def lines(self) -> dict[str, BusFile]:
        """Return all buses, keyed by name. In the short form, the bus name is empty."""
        return self.buses or {"": self.bus or BusFile()}

    def bus_of(self, joint: JointFile) -> str:
        """Return the name of the joint's bus."""
        return joint.bus or next(iter(self.lines()))

    def joints_on(self, bus: str) -> dict[str, JointFile]:
        """Return the joints whose servos are on this bus, keyed by name."""
        return {name: joint for name, joint in self.joints.items() if self.bus_of(joint) == bus}

    @field_validator("buses")
    @classmethod
    def _one_form(cls, buses: dict[str, BusFile] | None, info: ValidationInfo) -> dict[str, BusFile] | None:
        if info.data.get("bus", "with mistakes") is not None:
            raise ValueError("the file has both bus and buses: list every bus under buses, and remove bus")
        if buses and "world" in buses:
            raise ValueError("a bus must not be called world: emulators use PORT.world for the simulated world")
        return buses

    @field_validator("joints")
    @classmethod
    def _fit_together(cls, joints: dict[str, JointFile], info: ValidationInfo) -> dict[str, JointFile]:
        buses = info.data.get("buses") or {}
        # A joint without a specified bus belongs to the only bus.
        home = next(iter(buses)) if len(buses) == 1 else None
        placed = {name: joint.model_copy(update={"bus": joint.bus or home}) for name, joint in joints.items()}
        problems = _shared_ids(placed) + _mixed_protocols(placed) + _crowded_buses(placed)
        if "bus" in info.data and "buses" in info.data:  # an invalid key is missing from info.data
            problems += _bus_problems(joints, info.data["bus"], info.data["buses"])
        if problems:
            raise ValueError("; ".join(problems))
        return joints

    @field_validator("park")
    @classmethod
    def _known_joints(cls, park: ParkFile | None, info: ValidationInfo) -> ParkFile | None:
        if park and "joints" in info.data:
            unknown = park.pose.keys() - info.data["joints"].keys()
            if unknown:
                raise ValueError(f"pose has unknown joints: {', '.join(sorted(unknown))}")
        return park


def _shared_ids(joints: Mapping[str, JointFile]) -> list[str]:
    """List pairs of joints that use the same servo."""
    owners: dict[tuple[str | None, int], str] = {}
    problems: list[str] = []
    for name, joint in joints.items():
        other = owners.setdefault((joint.bus, joint.servo_id), name)
        if other != name:
            where = f" on bus {joint.bus}" if joint.bus else ""
            problems.append(f"{other} and {name} both have servo_id {joint.servo_id}{where}")
    return problems


def _bus_problems(
    joints: Mapping[str, JointFile], single: BusFile | None, several: Mapping[str, BusFile] | None
) -> list[str]:
    """List joints without a bus or on an unknown bus, joints that are incompatible with their bus, and buses without
    joints."""
    buses = several or {}
    problems: list[str] = []
    for name, joint in joints.items():
        if joint.bus is None and len(buses) > 1:
            problems.append(f"{name} has no bus: use one of {', '.join(buses)}")
        elif joint.bus is not None and not buses:
            problems.append(
                f"{name} is on bus {joint.bus}, but the file has no buses: remove its bus, or list the bus under buses"
            )
        elif joint.bus is not None and joint.bus not in buses:
            problems.append(f"{name} is on unknown bus {joint.bus}: use one of {', '.join(buses)}")
        else:
            bus = buses[joint.bus] if joint.bus else next(iter(buses.values()), single or BusFile())
            problems += _joint_problems(name, joint, bus.protocol)
    used = {joint.bus for joint in joints.values()}
    problems += [f"no joint is on bus {bus}" for bus in buses if len(buses) > 1 and bus not in used]
    return problems


def _joint_problems(name: str, joint: JointFile, protocol: Make) -> list[str]:
    """List the values of one joint that are incompatible with its bus or its servo model."""
    problems: list[str] = []
    model = MODELS[joint.model]
    if series_of(model).make != protocol:
        problems.append(f"{name} has model {joint.model}, which does not use the protocol of its bus ({protocol})")
    if joint.servo_id > LARGEST_IDS[protocol]:
        problems.append(
            f"{name} has servo_id {joint.servo_id}, but the highest {protocol} ID is {LARGEST_IDS[protocol]}"
        )
    if joint.position_p is not None and series_of(model).protocol is not PROTOCOL_2:
        problems.append(
            f"{name} has position_p, but only Dynamixel servos with protocol 2.0 support it: remove position_p"
        )
    if wrong := homing_mistake(model, joint.homing_offset):
        problems.append(f"{name}: {wrong}")
    if joint.extended and series_of(model) is not X:
        problems.append(f"{name}: an {joint.model} has no extended position mode: remove `extended`")
    if joint.firmware is not None and series_of(model) is not X:
        problems.append(
            f"{name} has firmware, but the firmware version can be set only for a virtual Dynamixel X: remove firmware"
        )
    problems += [f"{name}.settings: {mistake}" for mistake in mistakes(model, joint.settings)]
    return problems


def _mixed_protocols(joints: Mapping[str, JointFile]) -> list[str]:
    """List servos of one make that cannot share a bus because their protocols differ."""
    protocols: dict[tuple[str | None, Make], dict[str, str]] = {}
    for name, joint in joints.items():
        model = MODELS[joint.model]
        protocols.setdefault((joint.bus, series_of(model).make), {}).setdefault(series_of(model).protocol.name, name)
    return [
        f"{' and '.join(first.values())} cannot share a bus because they use {' and '.join(first)}: "
        "add a separate bus for each protocol under buses"
        for first in protocols.values()
        if len(first) > 1
    ]


def _crowded_buses(joints: Mapping[str, JointFile]) -> list[str]:
    """List buses with more servos than one packet has goals."""
    models: dict[str | None, list[ServoModel]] = {}
    for joint in joints.values():
        models.setdefault(joint.bus, []).append(MODELS[joint.model])
    return [f"{f'bus {bus}' if bus else 'the bus'} {text}" for bus, on in models.items() for text in too_many(on)]


def load_robot_file(path: Path) -> RobotFile:
    """Read a robot file together with the servo models and the calibration in the same folder.

    Servo protections that cannot take effect are logged as warnings.

    Args:
        path: The robot file.

    Raises:
        RobotFileError: The files contain errors. The message lists all errors with their file and line.
    """
    load_servo_models(path.parent)
    file, calibration = load(path, RobotFile, RobotFileError), load_calibration(path)
    for problem in unprotected(file):
        LOG.warning("%s: %s", path, problem)
    return file if calibration is None else _calibrated(file, calibration, calibration_path(path))


def unprotected(file: RobotFile) -> list[str]:
    """List servo protections that cannot take effect, with the joint and a remedy for each."""
    return [
        f"{name}: {problem}"
        for name, joint in file.joints.items()
        for problem in protection_problems(MODELS[joint.model], joint.torque_limit, joint.settings)
    ]


def _calibrated(file: RobotFile, calibration: CalibrationFile, path: Path) -> RobotFile:
    """Return the robot file with the calibration values applied.

    Raises RobotFileError if the robot file and the calibration contradict each other.
    """
    problems: list[str] = []
    joints, source = dict(file.joints), compose(path, RobotFileError)
    for name, found in calibration.joints.items():
        place = source.place(("joints", name))
        joint = joints.get(name)
        if joint is None or joint.servo_id != found.servo_id:
            has = "no such joint" if joint is None else f"servo {joint.servo_id} for this joint"
            problems.append(f"{place}: {name} was calibrated with servo {found.servo_id}, but the robot file has {has}")
            continue
        if wrong := homing_mistake(MODELS[joint.model], found.homing_offset):
            problems.append(f"{place}: {name}: {wrong}")
        if found.extended and series_of(MODELS[joint.model]) is not X:
            problems.append(f"{place}: {name}: an {joint.model} has no extended position mode: remove `extended`")
        update = found.model_dump(include={"sign", "zero_counts", "homing_offset", "extended"})
        joints[name] = joint.model_copy(update=update)
    if problems:
        raise RobotFileError("\n".join([*problems, "calibrate again, or remove the calibration file"]))
    return file.model_copy(update={"joints": joints})
