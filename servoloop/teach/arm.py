"""Arm for recording and playback: its hardware, its control loop and one controller for all joints."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

from controller.loop import ControlLoop
from controller.teach.freedrive_controller import FreedriveController, guided_joint
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from controller.trajectory.parameters import JointConstraints, TrajectoryParameters
from drivers.bus.bus import Bus
from drivers.clock import Clock
from drivers.port import Port
from hal.compensation.servo_compliance import lags
from hal.components.component_set import ComponentSet
from hal.servos.hand_guided_arm import HandGuidedArm
from servoloop.stack.background_worker import BackgroundWorker
from servoloop.stack.control_stack import ControlStack
from servoloop.stack.devices import world_feed
from servoloop.stack.hardware import HardwareSetup, compensation, compliances, open_buses
from servoloop.stack.robot_files import Files
from servoloop.teach.taught import TeachError
from servoloop.teleop.arms import Side, hand_joints

ARM: Final = "arm"
GOAL_TIME_S: Final = 1.0


@dataclass(frozen=True, slots=True)
class TeachArm:
    """Arm with its control loop, not yet configured."""

    stack: ControlStack
    hardware: HandGuidedArm

    @property
    def loop(self) -> ControlLoop:
        """Control loop of all joints."""
        return self.stack.loop

    @property
    def files(self) -> Files:
        """Files of the robot, with the rate of this control loop."""
        return self.stack.files

    @property
    def joints(self) -> tuple[str, ...]:
        """Joints in the order of measurements and commands."""
        return self.hardware.joints


def build_arm(
    side: Side,
    rate_hz: int,
    clock: Clock,
    worker: BackgroundWorker,
    soft: bool = False,
    tap: Callable[[Port, Clock], Port] = lambda port, clock: port,
) -> TeachArm:
    """Create the hardware and the control loop of an arm, without a controller.

    Args:
        side: Files and devices of the arm.
        rate_hz: Rate of the loop.
        clock: Clock of the loop.
        worker: Worker for tasks that take longer than a cycle.
        soft: Whether the arm is guided by hand while gravity is compensated.
        tap: Function that wraps each port, for example to record its bytes.
    """
    files, buses = side.files, dict[str, Bus]()
    joints = files.robot.joints

    def open_port(device: str, baud: int, clock: Clock) -> Port:
        return tap(side.open_port(device, baud, clock), clock)

    def opened() -> dict[str, Bus]:
        buses.update(open_buses(files.robot.file, side.devices, clock, open_port=open_port))
        return buses

    carried = compensation(joints, files.description, guided=soft)
    hardware = HandGuidedArm(ARM, joints, opened, clock, carried, soft)
    components = ComponentSet([hardware], clock)
    files = replace(files, controllers=replace(files.controllers, update_rate_hz=rate_hz))
    virtual = side.lines is not None or world_feed(side.devices) is not None
    rates_hz = dict.fromkeys(files.robot.file.lines(), float(rate_hz))
    setup = HardwareSetup(components, dict, {}, virtual, buses, rates_hz, compliances(joints))
    return TeachArm(ControlStack.build(setup, files, clock, worker), hardware)


def add_freedrive(arm: TeachArm) -> FreedriveController:
    """Add a controller that lets a person move all joints by hand. Raises TeachError if a joint would sink."""
    joints, hands = arm.files.robot.joints, hand_joints(arm.files)
    unknown = [joint.name for joint in joints if joint.compliance is None and joint.name not in hands]
    if unknown or arm.hardware.compensation is None:
        why = f"the stiffness of {', '.join(unknown)} is unknown" if unknown else "its gravity is not compensated"
        raise TeachError(
            f"the arm of {arm.files.robot_path} cannot be made soft, because {why}: use --limp, and hold the arm"
        )
    controller = FreedriveController("freedrive_controller", [guided_joint(joint) for joint in joints], arm.joints)
    arm.loop.manager.registry.add(controller)
    return controller


def add_trajectory(arm: TeachArm) -> JointTrajectoryController:
    """Add a trajectory controller for all joints, with the constraints of the controllers file."""
    joints = arm.files.robot.joints
    constraints = {"goal_time": GOAL_TIME_S, **_constraints(arm.files)}
    parameters = TrajectoryParameters.model_validate(
        {"joints": arm.joints, "interpolation_method": "ruckig", "constraints": constraints}
    )
    controller = JointTrajectoryController(
        "teach_controller",
        parameters,
        [joint.limits for joint in joints],
        arm.joints,
        settled=lambda controller: True,
        lags=lags([joint.compliance for joint in joints]),
    )
    arm.loop.manager.registry.add(controller)
    return controller


def _constraints(files: Files) -> dict[str, JointConstraints]:
    """Return the constraints of all trajectory controllers.

    A hand has no constraints, because an object may hold the hand open.
    """
    found: dict[str, JointConstraints] = {}
    for spec in files.controllers.controllers:
        if isinstance(spec.parameters, TrajectoryParameters):
            found |= spec.parameters.constraints.by_joint()
    return found
