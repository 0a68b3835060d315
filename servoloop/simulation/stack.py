"""Controllers, loop, driver, bytes, servos and physics in one thread on a simulated clock."""

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np

from controller.forward.forward_command_controller import ForwardCommandController
from controller.interface import Controller
from controller.manager.controllers_file import ControllersFileError
from controller.trajectory.goal import GoalHandle, GoalPoint, TrajectoryGoal
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from drivers.bus.bus import Bus
from drivers.port import Port
from hal.compensation.gravity_compensation import GravityCompensation
from hal.components.component_lifecycle import configure_all
from hal.components.component_set import ComponentSet
from hal.hardware import Hardware
from hal.joint import Joint
from hal.robot_description.description import Description
from hal.robot_description.hardware_info import HardwareInfo
from hal.servos.servo_hardware import ServoHardware
from hal.types import JointState
from servoloop.simulation.recording import RecordingPort, Trace
from servoloop.stack.control_stack import ControlStack
from servoloop.stack.hardware import HardwareSetup, compensation, compliances, servo_bus
from servoloop.stack.robot_files import Files, read_files
from servoloop.stack.virtual_lines import VirtualLines
from sim_backend.buses.build import NOMINAL_BUILD, Build
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.line.line import ServoLine
from sim_backend.scene.mujoco_hardware import MujocoHardware

AnyController = TypeVar("AnyController", JointTrajectoryController, ForwardCommandController)
MOVE_S = 2.0


class SimulatedStack:
    """Configured, not yet active. ``after_cycle`` is where a client's reactions come in."""

    def __init__(
        self,
        *,
        files: Files | None = None,
        wrap: Callable[[Controller], Controller] = lambda controller: controller,
        start: Sequence[float] | None = None,
        build: Build = NOMINAL_BUILD,
        keep_alive: bool = False,
        compensation: Callable[[Sequence[Joint], Description], GravityCompensation | None] = compensation,
        wire: bool = True,
    ) -> None:
        """``wrap`` may put something around a controller; ``start``: where the joints stand, rad or m.

        Without ``wire`` the arm is driven in MuJoCo itself, as by ``servoloop up --hardware mujoco``: no servos, no
        bytes, and no trace between the cycles.
        """
        self._compensation = compensation
        self.files = files or read_files()
        self.clock = SimulatedClock()
        self.trace = Trace()
        virtual = VirtualLines(self.files, build, start, self._after_step)
        self.world = virtual.world
        self.scene = virtual.scene
        self.lines = virtual.lines if wire else {}
        self.ports = {
            name: RecordingPort(VirtualPort(line, self.clock, name=f"virtual{name}"), self.clock)
            for name, line in self.lines.items()
        }
        self.tap: Callable[[Port], Port] = lambda port: port
        """What buses find at their ports may be put around them, until they are opened."""
        self.made: list[ServoHardware] = []
        """The components that have servos."""
        components = ComponentSet([self._made(one, wire) for one in self.files.description.components], self.clock)
        lagging = compliances(self.files.robot.joints)
        setup = HardwareSetup(components, dict, {}, True, {}, {}, lagging)
        self.control_stack = ControlStack.build(setup, self.files, self.clock, keep_alive=keep_alive)
        self.loop, self.manager = self.control_stack.loop, self.control_stack.loop.manager
        self.loop.on_cycle = self._on_cycle
        built = [self.control_stack.factory.make(spec) for spec in self.files.controllers.controllers]
        self.arm = _first(built, JointTrajectoryController, self.files)
        self._built = built
        self._arm_at = np.array(self.world.arrays.position_at[: len(self.arm.joints)])
        """Where the positions of the arm's joints are, without the hand's: each millisecond asks."""
        self._wrap = wrap
        for controller in built:
            self.add_controller(controller)
        self.after_cycle: Callable[[], None] = lambda: None
        self.on_state: Callable[[JointState], None] = lambda state: None
        """Given each cycle's measurement."""
        self.on_step: Callable[[float], None] = lambda time_s: None
        """Called after each step of the physics."""

    def add_controller(self, controller: Controller) -> None:
        """Load one that has been built; it is inactive until the stack is up, or it is switched."""
        self.manager.registry.add(self._wrap(controller))

    def up(self) -> "SimulatedStack":
        """Configure and activate. Raises DriverError or HalError if a component cannot be, as ``servoloop up`` does."""
        configure_all(self.loop.hardware)
        self.loop.activate(keep_alive=False)
        return self

    @property
    def hand(self) -> ForwardCommandController:
        """The controller of the hand. Raises ControllersFileError if the arm has none."""
        return _first(self._built, ForwardCommandController, self.files)

    # Most arms have one component on one line.

    @property
    def hardware(self) -> ServoHardware:
        """The first component with servos."""
        return self.made[0]

    @property
    def bus(self) -> ServoLine[Any]:
        """The first virtual line."""
        return next(iter(self.lines.values()))

    @property
    def port(self) -> RecordingPort:
        """Its port."""
        return next(iter(self.ports.values()))

    @property
    def virtual_port(self) -> VirtualPort:
        """The same below the recording."""
        return self.port.port

    def _made(self, component: HardwareInfo, wire: bool) -> Hardware:
        joints = [joint for joint in self.files.robot.joints if joint.name in component.joints]
        if not wire:
            return MujocoHardware(component.name, joints, self.world, self.clock)
        names = {joint.bus for joint in joints}

        def open_buses() -> dict[str, Bus]:
            return {name: bus for name, bus in self._open_buses().items() if name in names}

        made = ServoHardware(
            component.name, joints, open_buses, self.clock, self._compensation(joints, self.files.description)
        )
        self.made.append(made)
        return made

    def _open_buses(self) -> dict[str, Bus]:
        file, ports = self.files.robot.file, self.ports
        return {name: servo_bus(file, self.tap(port), self.clock, name) for name, port in ports.items()}

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        """Cycles for so long, or until ``until``."""
        end_s = self.clock.now() + seconds - 1e-9
        self.loop.run(lambda: self.clock.now() >= end_s or until())

    def go(self, pose: Sequence[float], seconds: float = MOVE_S) -> GoalHandle:
        """One goal as the pick-place node sends it."""
        goal = TrajectoryGoal(self.arm.joints, (GoalPoint(tuple(pose), seconds),))
        reason = self.arm.check(goal)
        assert reason is None, reason
        return self.arm.submit(goal)

    def _after_step(self, time_s: float) -> None:
        self.trace.world_s.append(time_s)
        self.trace.actual.append(self.world.arrays.position.take(self._arm_at))
        self.on_step(time_s)

    def _on_cycle(self, state: JointState) -> None:
        tracking = self.arm.tracking
        if tracking is not None:
            self.trace.cycle_s.append(tracking.stamp_s)
            self.trace.position.append(tracking.reference.position)
            self.trace.velocity.append(tracking.reference.velocity)
        self.on_state(state)
        self.after_cycle()


def _first(built: Sequence[Controller], kind: type[AnyController], files: Files) -> AnyController:
    """The first controller of a kind. Raises ControllersFileError."""
    for controller in built:
        if isinstance(controller, kind):
            return controller
    path = files.controllers.path
    raise ControllersFileError(f"{path}:1: no controller is a {kind.kind}, which simulated motions need: add one")
