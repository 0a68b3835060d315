"""The robot: its file and its URDF brought together, as the joints that servos drive."""

from dataclasses import dataclass

from drivers.servos.catalog import MODELS
from hal.errors import DescriptionError, RobotFileError
from hal.joint import Joint
from hal.robot_description.description import Description, HardwareInfo, UrdfJoint
from hal.robot_file.robot_file import JointFile, ParkFile, RobotFile
from hal.types import JointLimits


@dataclass(frozen=True, slots=True)
class Robot:
    """The robot file and the URDF, brought together for one hardware component."""

    joints: tuple[Joint, ...]
    file: RobotFile

    def limits(self) -> dict[str, JointLimits]:
        """Limits by joint name."""
        return {joint.name: joint.limits for joint in self.joints}


def assemble(file: RobotFile, description: Description, component: HardwareInfo) -> Robot:
    """Join file and URDF: each joint that takes commands needs a servo, and no servo is left over."""
    missing = [name for name in component.joints if name not in file.joints]
    extra = [name for name in file.joints if name not in component.joints]
    problems = [f"the URDF commands {name}, for which the robot file has no servo" for name in missing]
    problems += [f"the robot file has a servo for {name}, which the URDF does not command" for name in extra]
    joints: list[Joint] = []
    for name in component.joints:
        if name in file.joints:
            joint = _joint(name, file, description.joints[name])
            problems += _problems(description.joints[name], file.joints[name]) or _reach_problems(joint, file.park)
            joints.append(joint)
    if problems:
        raise RobotFileError("\n".join(problems))
    return Robot(tuple(joints), file)


def require_positions(component: HardwareInfo) -> None:
    """Raise DescriptionError unless it has joints, and each takes positions and nothing else, as servos do."""
    problems = [problem for name in component.joints for problem in _not_position_only(name, component)]
    if not component.joints:
        problems = ["it has no joint that a servo could drive: list its joints in the block, or take the block out"]
    if problems:
        raise DescriptionError("\n".join(f"{component.name}: {problem}" for problem in problems))


def _not_position_only(name: str, component: HardwareInfo) -> list[str]:
    commands = component.command_interfaces[name]
    if not commands:
        return [f"{name} has no command interface and mimics no joint: its servo needs one, position"]
    return [
        f"the URDF asks for {name}/{command} commands, and servos take positions only: use a controller of positions"
        for command in commands
        if command != "position"
    ]


def _problems(urdf: UrdfJoint, file: JointFile) -> list[str]:
    prismatic = urdf.kind == "prismatic"
    if not prismatic and urdf.kind != "revolute":
        return [f"{urdf.name} is {urdf.kind} in the URDF: a servo drives revolute and prismatic joints"]
    problems: list[str] = []
    if prismatic != (file.metres_per_radian is not None):
        need = "needs" if prismatic else "must not have"
        problems.append(f"{urdf.name} is {urdf.kind} in the URDF and {need} metres_per_radian")
    return problems


def _reach_problems(joint: Joint, park: ParkFile | None) -> list[str]:
    problems: list[str] = []
    lowest, highest = joint.counts_range()
    last = joint.model.last_count
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


def _joint(name: str, robot: RobotFile, urdf: UrdfJoint) -> Joint:
    file = robot.joints[name]
    bus, model = robot.bus_of(file), MODELS[file.model]
    return Joint(
        name=name,
        servo_id=file.servo_id,
        model=model,
        limits=urdf.limits(file.acceleration, file.jerk),
        stops=urdf.stops,
        sign=file.sign,
        zero_counts=(model.last_count + 1) // 2 if file.zero_counts is None else file.zero_counts,
        transmission=file.metres_per_radian or 1.0,
        torque_limit=file.torque_limit,
        bus=bus,
        position_p=file.position_p,
        homing_offset=file.homing_offset,
        extended=file.extended,
        settings=tuple(file.settings.items()),
        gravity_compensation=robot.gravity_compensation,
    )
