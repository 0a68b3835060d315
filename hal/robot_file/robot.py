"""Combine a robot file and a URDF into the joints that servos drive."""

from dataclasses import dataclass, replace

from drivers.servos.catalog import MODELS
from hal.hal_errors import DescriptionError, RobotFileError
from hal.joint import Joint
from hal.robot_description.description import Description, HardwareInfo, UrdfJoint
from hal.robot_description.transmissions import NO_GEAR, SimpleTransmission
from hal.robot_file.robot_file import JointFile, ParkFile, RobotFile
from hal.types import JointLimits


@dataclass(frozen=True, slots=True)
class Robot:
    """Joints of one hardware component, combined from its robot file and the URDF."""

    joints: tuple[Joint, ...]
    file: RobotFile

    def limits(self) -> dict[str, JointLimits]:
        """Return the joint limits, keyed by joint name."""
        return {joint.name: joint.limits for joint in self.joints}


def assemble(file: RobotFile, description: Description, component: HardwareInfo) -> Robot:
    """Combine a robot file and a URDF.

    Raises:
        RobotFileError: The commanded joints and the servos do not match one to one, or their values contradict each
            other.
    """
    missing = [name for name in component.joints if name not in file.joints]
    extra = [name for name in file.joints if name not in component.joints]
    problems = [f"the URDF commands {name}, but the robot file has no servo for it: add a servo" for name in missing]
    problems += [
        f"the robot file has a servo for {name}, but the URDF does not command it: remove the servo" for name in extra
    ]
    problems += [
        f'the sensor {name} ({sensor.place}) has no source: specify a joint in <param name="joint">'
        for name, sensor in component.sensors.items()
        if sensor.interfaces and not sensor.joint
    ]
    joints: list[Joint] = []
    for name in component.joints:
        if name in file.joints:
            joint = _joint(file, description.joints[name], component.transmissions.get(name, NO_GEAR))
            problems += _problems(description.joints[name], file.joints[name]) or _reach_problems(joint, file.park)
            joints.append(joint)
    if problems:
        raise RobotFileError("\n".join(problems))
    return Robot(tuple(joints), file)


def require_positions(component: HardwareInfo) -> None:
    """Raise DescriptionError unless the component has joints and each joint accepts only position commands."""
    problems = [problem for name in component.joints for problem in _not_position_only(name, component)]
    if not component.joints:
        problems = ["the block has no joint that a servo could drive: list its joints, or remove the block"]
    if problems:
        raise DescriptionError("\n".join(f"{component.name}: {problem}" for problem in problems))


def _not_position_only(name: str, component: HardwareInfo) -> list[str]:
    commands = component.command_interfaces[name]
    if not commands:
        return [f"{name} has no command interface and is not a mimic joint: add a position command interface"]
    return [
        f"the URDF has the command interface {name}/{command}, but servos take only positions: use a position "
        "interface and a position controller"
        for command in commands
        if command != "position"
    ]


def _problems(urdf: UrdfJoint, file: JointFile) -> list[str]:
    prismatic = urdf.kind == "prismatic"
    if not prismatic and urdf.kind != "revolute":
        return [f"{urdf.name} is {urdf.kind} in the URDF, but a servo can drive only revolute and prismatic joints"]
    problems: list[str] = []
    if prismatic != (file.metres_per_radian is not None):
        need = "needs" if prismatic else "must not have"
        problems.append(f"{urdf.name} is {urdf.kind} in the URDF and {need} metres_per_radian")
    return problems


def _reach_problems(joint: Joint, park: ParkFile | None) -> list[str]:
    problems: list[str] = []
    lowest, highest = joint.counts_range()
    last = joint.model.last_count
    if lowest < 0 or highest > last:  # after its last count a servo reports 0, so the position would jump
        problems.append(
            f"{joint.name}: the limits correspond to counts {lowest} to {highest}, but the servo has only 0 to {last}: "
            "narrow the limits, or mount the servo so that zero_counts is closer to the middle"
        )
    lower, upper = joint.limits.lower, joint.limits.upper
    position = park.pose.get(joint.name, lower) if park else lower
    if not lower <= position <= upper:
        problems.append(f"park.pose: {position} is outside the limits {lower} to {upper} of {joint.name}")
    return problems


def _joint(robot: RobotFile, urdf: UrdfJoint, gear: SimpleTransmission) -> Joint:
    file = robot.joints[urdf.name]
    bus, model = robot.bus_of(file), MODELS[file.model]
    made = Joint(
        name=urdf.name,
        servo_id=file.servo_id,
        model=model,
        limits=urdf.limits(file.acceleration, file.jerk),
        stops=urdf.stops,
        sign=file.sign if gear.reduction > 0.0 else -file.sign,
        zero_counts=(model.last_count + 1) // 2 if file.zero_counts is None else file.zero_counts,
        transmission=(file.metres_per_radian or 1.0) / abs(gear.reduction),
        reduction=abs(gear.reduction),
        torque_limit=file.torque_limit,
        bus=bus,
        position_p=file.position_p,
        homing_offset=file.homing_offset,
        extended=file.extended,
        firmware=file.firmware,
        settings=tuple(file.settings.items()),
        gravity_compensation=robot.gravity_compensation,
    )
    if file.zero_counts is not None:  # These counts are for joint position 0, so they already include the offset.
        return made
    return replace(made, zero_counts=made.zero_counts - round(gear.offset / made.units_per_count))
