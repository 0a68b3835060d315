"""The whole stack below ROS in one thread on simulated time, from the controllers to the physics."""

from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from controller.forward.forward_command_controller import ForwardCommandController
from controller.interface import Controller, ControllerContext
from controller.loop import ControlLoop
from controller.manager.factory import Factory
from controller.manager.manager import ControllerManager
from controller.trajectory.goal import GoalHandle, GoalPoint, TrajectoryGoal
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from drivers.bus.bus import Bus
from hal.component_lifecycle import configure_all
from hal.component_set import ComponentSet
from hal.description import Description
from hal.gravity_compensation import GravityCompensation
from hal.hardware_info import HardwareInfo
from hal.joint import Joint
from hal.servo_hardware import ServoHardware
from hal.types import FloatArray, JointState
from nodes.pick_place.settings import Settings
from servoloop.demo.following_error import FollowingError, between_cycles
from servoloop.emulator import couplings, virtual_lines
from servoloop.files import Files, read_files
from servoloop.hardware import compensation, compliances, servo_bus
from sim_backend.build import Build
from sim_backend.clock import SimulatedClock
from sim_backend.feeder import Feeder
from sim_backend.plant import WorldPlant
from sim_backend.port import VirtualPort
from sim_backend.world import World

ARM = tuple(f"joint{i}" for i in range(1, 7))
READY = (0.0, -0.3643, -0.6419, -0.8154, -0.9541, -1.6828)
PICK = (0.0, -0.35, -0.70, -0.70, -1.10, 1.55)
BINS = {
    "A": (0.4, -0.2, -0.8, -0.6, -1.1, 1.55),
    "B": (0.0, -0.2, -0.8, -0.6, -1.1, 1.55),
    "C": (-0.4, -0.2, -0.8, -0.6, -1.1, 1.55),
}
OPEN_M, CLOSED_M = 0.0, 0.05
NOMINAL_BUILD = Build()
MOVE_S = 2.0
ROBOT_ARM = Settings()


@dataclass(slots=True)
class RecordingPort:
    """A port that remembers what went over it and when."""

    port: VirtualPort
    clock: SimulatedClock
    sent: list[tuple[float, bytes]] = field(default_factory=list)
    received: list[tuple[float, bytes]] = field(default_factory=list)
    on_write: Callable[[bytes], None] = lambda data: None

    @property
    def name(self) -> str:
        return self.port.name

    @property
    def baud(self) -> int:
        return self.port.baud

    def write(self, data: bytes) -> None:
        now_s = self.clock.now()
        self.on_write(data)
        self.port.write(data)
        self.sent.append((now_s, data))

    def read(self, size: int, deadline_s: float) -> bytes:
        data = self.port.read(size, deadline_s)
        self.received.append((self.clock.now(), data))
        return data

    def discard_input(self) -> None:
        self.port.discard_input()

    def close(self) -> None:
        self.port.close()


@dataclass(slots=True)
class Trace:
    """What the arm did every millisecond, and what it was to do at every cycle."""

    world_s: list[float] = field(default_factory=list)
    actual: list[FloatArray] = field(default_factory=list)
    cycle_s: list[float] = field(default_factory=list)
    position: list[FloatArray] = field(default_factory=list)
    velocity: list[FloatArray] = field(default_factory=list)

    def following_error(self) -> tuple[FloatArray, FloatArray]:
        """Largest error, and RMS while moving, of each arm joint (rad), between the cycles too."""
        error = self.following()
        return np.array(error.largest_rad), np.array(error.rms_moving_rad)

    def following(self, since_s: float = 0.0) -> FollowingError:
        """The following error, between the cycles too."""
        start = bisect_left(self.world_s, since_s)
        cycles, position, velocity = np.array(self.cycle_s), np.array(self.position), np.array(self.velocity)
        return between_cycles(self.world_s[start:], self.actual[start:], cycles, position, velocity)


class StackRig:
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
    ) -> None:
        self._compensation = compensation
        self.files = files or read_files()
        self.clock = SimulatedClock()
        ways = couplings(self.files.robot)
        self.world = World(self.files.scene, initial_position=start, spread=build.spread, backlash=build.gaps(ways))
        self.trace = Trace()
        self._feeder = Feeder()
        plant = WorldPlant(self.world, ways, self._after_step)
        robot = self.files.robot
        self.lines = virtual_lines(robot, plant, build.spread)
        self.ports = {
            name: RecordingPort(VirtualPort(line, self.clock, name=f"virtual{name}"), self.clock)
            for name, line in self.lines.items()
        }
        # Most tests have one line.
        self.bus, self.port = next(iter(self.lines.values())), next(iter(self.ports.values()))
        self.virtual_port = self.port.port
        self.made = [self._made(component) for component in self.files.description.components]
        self.hardware = self.made[0]
        components = ComponentSet(self.made, self.clock)
        limits = self.files.limits
        self.manager = ControllerManager(components, limits)
        context = ControllerContext(
            self.files.description,
            self.files.component,
            limits,
            self.manager.cycle.settled,
            compliances(self.files.robot.joints),
        )
        factory = Factory(self.files.controllers, context)
        built = [factory.make(spec) for spec in self.files.controllers.controllers]
        self.arm = next(c for c in built if isinstance(c, JointTrajectoryController))
        self.hand = next(c for c in built if isinstance(c, ForwardCommandController))
        for controller in built:
            self.manager.registry.add(wrap(controller))
        self.after_cycle: Callable[[], None] = lambda: None
        period_s = 1.0 / self.files.controllers.update_rate_hz
        self.loop = ControlLoop(
            components, self.manager, limits, self.clock, period_s, self._on_cycle, keep_alive=keep_alive
        )

    def up(self) -> "StackRig":
        """Configure and activate."""
        configure_all(self.loop.hardware)
        self.loop.activate()
        return self

    def _made(self, component: HardwareInfo) -> ServoHardware:
        joints = [joint for joint in self.files.robot.joints if joint.name in component.joints]
        names = {joint.bus for joint in joints}

        def open_buses() -> dict[str, Bus]:
            return {name: bus for name, bus in self._open_buses().items() if name in names}

        made = ServoHardware(
            component.name, joints, open_buses, self.clock, self._compensation(joints, self.files.description)
        )
        return made

    def _open_buses(self) -> dict[str, Bus]:
        return {name: servo_bus(self.files.robot.file, port, self.clock, name) for name, port in self.ports.items()}

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
        self._feeder.update(self.world, time_s)
        self.trace.world_s.append(time_s)
        self.trace.actual.append(self.world.position()[: len(self.arm.joints)])

    def _on_cycle(self, state: JointState) -> None:
        tracking = self.arm.tracking
        if tracking is not None:
            self.trace.cycle_s.append(tracking.stamp_s)
            self.trace.position.append(tracking.reference.position)
            self.trace.velocity.append(tracking.reference.velocity)
        self.after_cycle()


class UnpacedJob:
    """The pick-place node's job by the letter: the hand is told, and the arm in the same instant."""

    def __init__(self, rig: StackRig, grade: str, settings: Settings = ROBOT_ARM) -> None:
        self._rig = rig
        self._steps = [
            (None, settings.ready_rad),
            (settings.hand_open_m, settings.pick_rad),
            (settings.hand_closed_m, settings.bins_rad[grade]),
            (settings.hand_open_m, settings.ready_rad),
        ]
        self.handles: list[GoalHandle] = []

    @property
    def done(self) -> bool:
        return not self._steps and self.handles[-1].done

    def react(self) -> None:
        """Called after each cycle: sends what comes next as soon as the last goal is decided."""
        if self._steps and (not self.handles or self.handles[-1].done):
            hand_m, pose = self._steps.pop(0)
            if hand_m is not None:
                assert self._rig.hand.submit([hand_m]) is None
            self.handles.append(self._rig.go(pose))

    def run(self, longest_s: float = 20.0) -> None:
        """From beginning to end."""
        self._rig.after_cycle = self.react
        self._rig.run(longest_s, lambda: self.done)
        self._rig.after_cycle = lambda: None
