"""Run the controllers, loop, driver, virtual servos and physics in one thread on a simulated clock."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, TypeVar

import numpy as np

from controller.component_transitions import ComponentTransition
from controller.forward.forward_command_controller import ForwardCommandController
from controller.interface import Controller
from controller.manager_errors import ControllersFileError
from controller.trajectory.goal import GoalHandle, GoalPoint, TrajectoryGoal
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from controller.trajectory.sampler import Tracking
from drivers.bus.bus import Bus
from drivers.port import Port
from hal.components.component_lifecycle import configure_all
from hal.hardware import Hardware
from hal.joint import Joint
from hal.outputs import Outputs
from hal.robot_description.description import Description
from hal.robot_description.hardware_info import HardwareInfo
from hal.servos.gravity_compensation import GravityCompensation
from hal.servos.servo_hardware import ServoHardware
from hal.servos.servo_outputs import ServoOutputs
from hal.types import JointState
from servoloop.recording.bus_tap import BusTap
from servoloop.simulation.observed_components import ObservedComponents
from servoloop.simulation.recording import Trace
from servoloop.stack.control_stack import ControlStack
from servoloop.stack.hardware import HardwareSetup, compensation, compliances, servo_bus
from servoloop.stack.robot_files import Files, read_files
from servoloop.stack.virtual_lines import VirtualLines
from sim_backend.buses.build import NOMINAL_BUILD, Build
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.line.line import ServoLine
from sim_backend.scene.mujoco_hardware import MujocoHardware
from sim_backend.scene.world import World

AnyController = TypeVar("AnyController", JointTrajectoryController, ForwardCommandController)
MOVE_S = 2.0


class SimulatedStack:
    """Control stack that runs in simulated time. The stack is inactive until ``up`` is called.

    Clients react to cycles in ``after_cycle``.
    """

    def __init__(
        self,
        *,
        files: Files | None = None,
        start: Sequence[float] | None = None,
        build: Build = NOMINAL_BUILD,
        keep_alive: bool = False,
        compensation: Callable[[Sequence[Joint], Description], GravityCompensation | None] = compensation,
        wire: bool = True,
    ) -> None:
        """Build the stack.

        Args:
            files: Files of the robot; None to use the default arm.
            start: Initial joint positions, in rad or m. If None, the arm rests in the scene's keyframe until driven.
            build: Build of the virtual servos.
            keep_alive: Whether the loop continues when it loses a component.
            compensation: Function that creates the gravity compensation.
            wire: Whether to simulate servos and buses. If False, MuJoCo drives the arm directly, as with ``servoloop up
                --hardware mujoco``, and there is no trace between the cycles.
        """
        self._compensation = compensation
        self.files = files or read_files()
        self.clock = SimulatedClock()
        virtual = VirtualLines(self.files, build, start, self._after_step)
        self.world = virtual.world
        self.scene = virtual.scene
        self.lines = virtual.lines if wire else {}
        self.ports = {
            name: BusTap(VirtualPort(line, self.clock, name=f"virtual{name}"), self.clock)
            for name, line in self.lines.items()
        }
        self.tap: Callable[[Port], Port] = lambda port: port
        """Function that wraps each port when its bus is opened."""
        self.made: list[ServoHardware] = []
        """Components with servos."""
        self.outputs = Outputs(self.files.component.outputs)
        made = [self._made(one, wire) for one in self.files.description.components]
        self.components = ObservedComponents(made, self.clock)
        lagging = compliances(self.files.robot.joints)
        setup = HardwareSetup(self.components, dict, {}, True, {}, {}, lagging, self.outputs)
        self.control_stack = ControlStack.build(setup, self.files, self.clock, keep_alive=keep_alive)
        self.loop, self.manager = self.control_stack.loop, self.control_stack.loop.manager
        self.loop.on_cycle = self._on_cycle
        built = [self.control_stack.factory.make(spec) for spec in self.files.controllers.controllers]
        self.arm = _first(built, JointTrajectoryController, self.files)
        self._built = built
        self.arms = tuple(one for one in built if isinstance(one, JointTrajectoryController))
        """Trajectory controllers of all arms. ``arm`` is the first of these controllers."""
        self._traces = [_ArmTrace(one, self.world) for one in self.arms]
        self.trace = self._traces[0].trace
        """Trace of the first arm."""
        for controller in built:
            self.add_controller(controller)
        self.activations: list[ComponentTransition] = []
        """Activations that clients have requested. An observer may remove those that it has seen."""
        self.after_cycle: Callable[[], None] = lambda: None
        self.on_state: Callable[[JointState], None] = lambda state: None
        """Function called with the joint state of each cycle."""
        self.on_step: Callable[[float], None] = lambda time_s: None
        """Function called after each physics step."""

    def add_controller(self, controller: Controller) -> None:
        """Load a controller. The controller stays inactive until it is switched on or ``up`` is called."""
        self.manager.registry.add(self.wrapped(controller))

    def wrapped(self, controller: Controller) -> Controller:
        """Return the controller to load. Subclasses wrap the controller, for example to inject faults."""
        return controller

    def up(self) -> "SimulatedStack":
        """Configure and activate the stack. Raises DriverError or HalError if a component fails."""
        configure_all(self.loop.hardware)
        self.loop.activate(keep_alive=False)
        return self

    def trace_of(self, joints: Sequence[str]) -> Trace:
        """Return the trace of the arm with these joints."""
        return next(one.trace for one in self._traces if one.joints == tuple(joints))

    def controller(self, name: str) -> Controller | None:
        """Return the controller with this name, or None."""
        return next((controller for controller in self._built if controller.name == name), None)

    @property
    def hand(self) -> ForwardCommandController:
        """Controller of the hand. Raises ControllersFileError if the arm has no hand."""
        return _first(self._built, ForwardCommandController, self.files)

    # The following properties are for arms with one component on one bus.

    @property
    def hardware(self) -> ServoHardware:
        """First component that has servos."""
        return self.made[0]

    @property
    def bus(self) -> ServoLine[Any]:
        """First virtual bus."""
        return next(iter(self.lines.values()))

    @property
    def port(self) -> BusTap[VirtualPort]:
        """Recording port of the first bus."""
        return next(iter(self.ports.values()))

    @property
    def virtual_port(self) -> VirtualPort:
        """Virtual port of the first bus, without recording."""
        return self.port.port

    def _made(self, component: HardwareInfo, wire: bool) -> Hardware:
        joints = [joint for joint in self.files.robot.joints if joint.name in component.joints]
        if not wire:
            mujoco = MujocoHardware(component.name, joints, self.world, self.clock)
            mujoco.outputs = tuple(component.outputs)
            return mujoco
        names = dict.fromkeys(joint.bus for joint in joints)
        open_buses = {name: partial(self._open_bus, name) for name in self.ports if name in names}
        carried = self._compensation(joints, self.files.description)
        outputs = ServoOutputs(component, joints, self.outputs)
        made = ServoHardware(component.name, joints, open_buses, self.clock, carried, outputs)
        self.made.append(made)
        return made

    def _open_bus(self, name: str) -> Bus:
        return servo_bus(self.files.robot.file, self.tap(self.ports[name]), self.clock, name)

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        """Run cycles for ``seconds`` seconds, or until ``until`` returns true."""
        end_s = self.clock.now() + seconds - 1e-9
        self.loop.run(lambda: self.clock.now() >= end_s or until())

    def go(self, pose: Sequence[float], seconds: float = MOVE_S) -> GoalHandle:
        """Send a goal with one pose, as the pick-place node does."""
        goal = TrajectoryGoal(self.arm.joints, (GoalPoint(tuple(pose), seconds),))
        reason = self.arm.check(goal)
        assert reason is None, reason
        return self.arm.submit(goal)

    def _after_step(self, time_s: float) -> None:
        for one in self._traces:
            one.after_step(time_s)
        self.on_step(time_s)

    def _on_cycle(self, state: JointState) -> None:
        for arm, one in zip(self.arms, self._traces, strict=True):
            one.on_cycle(arm.tracking)
        self.on_state(state)
        self.after_cycle()


class _ArmTrace:
    """Trace of one arm of the simulated world."""

    def __init__(self, arm: JointTrajectoryController, world: World) -> None:
        self.joints = tuple(arm.joints)
        self.trace = Trace()
        places = [list(world.joints).index(joint) for joint in arm.joints]
        self._at = np.array(world.arrays.position_at)[places]
        """Indices of the arm joints, without the hand, in the world's position array."""
        self._arrays = world.arrays

    def after_step(self, time_s: float) -> None:
        """Add the positions at the end of one millisecond."""
        self.trace.world_s.append(time_s)
        self.trace.actual.append(self._arrays.position.take(self._at))

    def on_cycle(self, tracking: Tracking | None) -> None:
        """Add the reference of a cycle, if the arm is controlled."""
        if tracking is not None:
            self.trace.cycle_s.append(tracking.stamp_s)
            self.trace.position.append(tracking.reference.position)
            self.trace.velocity.append(tracking.reference.velocity)


def _first(built: Sequence[Controller], kind: type[AnyController], files: Files) -> AnyController:
    """Return the first controller of a given class. Raises ControllersFileError if there is no such controller."""
    for controller in built:
        if isinstance(controller, kind):
            return controller
    path = files.controllers.path
    raise ControllersFileError(f"{path}:1: simulated motions require a {kind.kind}: add such a controller")
