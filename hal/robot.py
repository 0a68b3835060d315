"""The robot file: which servo drives which joint, and how the arm is left."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator

from drivers.dynamixel import x_series
from drivers.feetech import sts
from drivers.registers import ServoModel
from hal.description import Component, Description, UrdfJoint
from hal.errors import RobotFileError
from hal.joint import Joint
from hal.types import JointLimits
from hal.yaml_file import load

Protocol = Literal["feetech", "dynamixel"]
ExitPolicy = Literal["hold", "relax"]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]

MODELS: dict[Protocol, dict[str, ServoModel]] = {"feetech": sts.MODELS, "dynamixel": x_series.MODELS}
"""What can be driven, by the protocol of its bus."""
LARGEST_IDS: dict[Protocol, int] = {"feetech": 253, "dynamixel": 252}


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class BusFile(_Strict):
    """The line to the servos. Which device it is, the command line says."""

    protocol: Protocol = "feetech"
    baud: int = Field(default=1_000_000, gt=0)


class JointFile(_Strict):
    """One joint's servo. Units: rad (m for a prismatic joint) and seconds."""

    servo_id: int = Field(ge=0, le=253)
    model: str
    sign: Literal[1, -1] = 1
    zero_counts: int = Field(2048, ge=-32767, le=32767)
    metres_per_radian: Positive | None = None
    torque_limit: float = Field(1.0, gt=0, le=1)
    position_p: int | None = Field(None, ge=0, le=16383)
    """Dynamixel's position P gain, which lives in RAM; None leaves it as the servo has it."""
    acceleration: Positive
    jerk: Positive

    @field_validator("model")
    @classmethod
    def _known_model(cls, model: str) -> str:
        known = [name for models in MODELS.values() for name in models]
        if model not in known:
            raise ValueError(f"unknown model {model}: known are {', '.join(known)}")
        return model


class ExitFile(_Strict):
    """What becomes of the torque at the end, on virtual and on real servos."""

    virtual: ExitPolicy = "hold"
    real: ExitPolicy = "relax"


class ParkFile(_Strict):
    """Where to go before letting go, at which share of the joints' velocity limits."""

    pose: dict[str, Finite]
    velocity_scale: float = Field(0.25, gt=0, le=1)


class RobotFile(_Strict):
    """The whole file."""

    bus: BusFile = BusFile()
    joints: dict[str, JointFile]
    on_exit: ExitFile = ExitFile()
    park: ParkFile | None = None
    controller_defaults: dict[str, dict[str, Any]] = {}

    @field_validator("joints")
    @classmethod
    def _one_servo_a_joint(cls, joints: dict[str, JointFile]) -> dict[str, JointFile]:
        owners: dict[int, str] = {}
        doubles: list[str] = []
        for name, joint in joints.items():
            other = owners.setdefault(joint.servo_id, name)
            if other != name:
                doubles.append(f"{other} and {name} both have servo_id {joint.servo_id}")
        if doubles:
            raise ValueError("; ".join(doubles))
        return joints

    @field_validator("joints")
    @classmethod
    def _fit_for_the_bus(cls, joints: dict[str, JointFile], info: ValidationInfo) -> dict[str, JointFile]:
        bus = info.data.get("bus", BusFile())
        problems = [problem for name, joint in joints.items() for problem in _misfits(name, joint, bus.protocol)]
        if problems and "bus" in info.data:
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


def _misfits(name: str, joint: JointFile, protocol: Protocol) -> list[str]:
    """What one joint's servo asks for that its bus does not have."""
    problems: list[str] = []
    if joint.model not in MODELS[protocol]:
        problems.append(f"{name} has model {joint.model}, which does not speak the bus's protocol, {protocol}")
    if joint.servo_id > LARGEST_IDS[protocol]:
        problems.append(f"{name} has servo_id {joint.servo_id}, and {protocol} has IDs up to {LARGEST_IDS[protocol]}")
    if joint.position_p is not None and protocol != "dynamixel":
        problems.append(f"{name} has position_p, which only dynamixel servos take from here")
    return problems


@dataclass(frozen=True, slots=True)
class Robot:
    """The robot file and the URDF, brought together for one hardware component."""

    joints: tuple[Joint, ...]
    file: RobotFile

    def limits(self) -> dict[str, JointLimits]:
        """Limits by joint name."""
        return {joint.name: joint.limits for joint in self.joints}


def load_robot_file(path: Path) -> RobotFile:
    """Read the robot file. Raises RobotFileError with every mistake, its file and line."""
    return load(path, RobotFile, RobotFileError)


def assemble(file: RobotFile, description: Description, component: Component) -> Robot:
    """Join file and URDF: each joint that takes commands needs a servo, and no servo is left over."""
    missing = [name for name in component.joints if name not in file.joints]
    extra = [name for name in file.joints if name not in component.joints]
    problems = [f"the URDF commands {name}, for which the robot file has no servo" for name in missing]
    problems += [f"the robot file has a servo for {name}, which the URDF does not command" for name in extra]
    joints: list[Joint] = []
    for name in component.joints:
        if name in file.joints:
            joint = _joint(name, file.joints[name], description.joints[name], file.bus.protocol)
            problems += _problems(description.joints[name], file.joints[name]) or _reach_problems(joint, file.park)
            joints.append(joint)
    if problems:
        raise RobotFileError("\n".join(problems))
    return Robot(tuple(joints), file)


def _problems(urdf: UrdfJoint, file: JointFile) -> list[str]:
    prismatic = urdf.kind == "prismatic"
    if not prismatic and urdf.kind != "revolute":
        return [f"{urdf.name} is {urdf.kind} in the URDF: a servo drives revolute and prismatic joints"]
    problems: list[str] = []
    if prismatic != (file.metres_per_radian is not None):
        need = "needs" if prismatic else "must not have"
        problems.append(f"{urdf.name} is {urdf.kind} in the URDF and {need} metres_per_radian")
    if urdf.velocity <= 0 or urdf.lower >= urdf.upper:
        problems.append(f"{urdf.name} needs <limit lower upper velocity> in the URDF, lower < upper")
    return problems


def _reach_problems(joint: Joint, park: ParkFile | None) -> list[str]:
    problems: list[str] = []
    lowest, highest = joint.counts_range()
    last = joint.model.counts_per_turn - 1
    if lowest < 0 or highest > last:  # past its last count a servo says 0: the joint would seem to leap
        problems.append(
            f"{joint.name}: its limits are the servo's counts {lowest} to {highest}, and the servo has 0 to {last}: "
            "narrow the limits, or mount the servo so that zero_counts is nearer to the middle"
        )
    lower, upper = joint.limits.lower, joint.limits.upper
    position = park.pose.get(joint.name, lower) if park else lower
    if not lower <= position <= upper:
        problems.append(f"park.pose: {position} is outside the limits {lower} to {upper} of {joint.name}")
    return problems


def _joint(name: str, file: JointFile, urdf: UrdfJoint, protocol: Protocol) -> Joint:
    limits = JointLimits(urdf.lower, urdf.upper, urdf.velocity, file.acceleration, file.jerk)
    return Joint(
        name=name,
        servo_id=file.servo_id,
        model=MODELS[protocol][file.model],
        limits=limits,
        sign=file.sign,
        zero_counts=file.zero_counts,
        transmission=file.metres_per_radian or 1.0,
        torque_limit=file.torque_limit,
    )
