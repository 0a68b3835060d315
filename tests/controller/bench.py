"""Test bench with controllers on a mock arm with two joints and a hand, in simulated time."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from controller.forward.forward_command_controller import ForwardCommandController
from controller.interface import Controller
from controller.loop import ControlLoop
from controller.manager.manager import ControllerManager
from controller.trajectory.goal import GoalHandle, GoalPoint, TrajectoryGoal
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from controller.trajectory.parameters import TrajectoryParameters
from controller.trajectory.tolerances import Tolerances
from hal.components.component_set import ComponentSet
from hal.mock_hardware import MockHardware
from hal.types import FloatArray, JointCommand, JointFault, JointLimits, JointState
from sim_backend.clock import SimulatedClock

PERIOD_S = 0.05
ARM = ("shoulder", "elbow")
HAND = "finger"
JOINTS = (*ARM, HAND)
ARM_LIMITS = JointLimits(-2.0, 2.0, 4.0, 12.0, 120.0)
HAND_LIMITS = JointLimits(0.0, 0.05, 0.1, 1.0, 20.0)
LIMITS = {**dict.fromkeys(ARM, ARM_LIMITS), HAND: HAND_LIMITS}


class ScriptedHardware(MockHardware):
    """Mock hardware whose joints can be stuck, slow or silent, and whose calls can fail."""

    def __init__(self, clock: SimulatedClock) -> None:
        super().__init__("scripted", JOINTS, clock, calculate_dynamics=True)
        self.faults: dict[str, JointFault] = {}
        self.stuck: set[str] = set()
        self.slow: dict[str, float] = {}
        """Maximum motion of a slow joint in one period, by joint name."""
        self.objects: dict[str, float] = {}
        """Position at which an obstacle blocks a joint's upward motion, by joint name."""
        self.failing: dict[str, Exception] = {}
        """Error that a call raises, by the name of the call."""
        self.calls: list[str] = []
        self.written: list[FloatArray] = []
        self.deadlines: list[float | None] = []
        """Deadline of each requested measurement."""
        self.read_s = 0.0
        """Duration of a measurement, in seconds."""

    def place(self, joint: str, position: float) -> None:
        """Set the position at which a joint stands."""
        self._position[self.joints.index(joint)] = position

    def request(self, deadline_s: float | None = None) -> None:
        self.deadlines.append(deadline_s)

    def read(self) -> JointState:
        self._called("read")
        self._clock.sleep_until(self._clock.now() + self.read_s)
        state = super().read()
        return JointState(state.stamp_s, state.position, state.velocity, state.effort, dict(self.faults))

    def write(self, command: JointCommand) -> None:
        self._called("write")
        self.written.append(command.values.copy())
        super().write(JointCommand(self._reached(command.values), command.period_s))

    def deactivate(self, relax: bool) -> Sequence[str]:
        self._called("relax" if relax else "hold")
        return super().deactivate(relax)

    def cleanup(self) -> None:
        self._called("cleanup")
        super().cleanup()

    def _called(self, what: str) -> None:
        self.calls.append(what)
        if what in self.failing:
            raise self.failing[what]

    def _reached(self, wanted: FloatArray) -> FloatArray:
        way = wanted - self._position
        for index, name in enumerate(self.joints):
            if name in self.stuck:
                way[index] = 0.0
            reach = self.slow.get(name, np.inf)
            way[index] = np.clip(way[index], -reach, reach)
            way[index] = min(way[index], self.objects.get(name, np.inf) - self._position[index])
        return self._position + way


def arm_parameters(**said: object) -> TrajectoryParameters:
    """Return the arm's parameters, with ruckig as the default interpolation method."""
    return TrajectoryParameters.model_validate({"joints": ARM, "interpolation_method": "ruckig"} | said)


@dataclass(slots=True)
class Bench:
    """A loop with an arm controller and a hand controller."""

    settings: TrajectoryParameters = field(default_factory=arm_parameters)
    wrap: Callable[[Controller], Controller] = lambda controller: controller
    clock: SimulatedClock = field(default_factory=lambda: SimulatedClock(10.0))
    hardware: ScriptedHardware = field(init=False)
    manager: ControllerManager = field(init=False)
    arm: JointTrajectoryController = field(init=False)
    hand: ForwardCommandController = field(init=False)
    loop: ControlLoop = field(init=False)

    def __post_init__(self) -> None:
        self.hardware = ScriptedHardware(self.clock)
        components = ComponentSet([self.hardware], self.clock)
        self.manager = ControllerManager(components, LIMITS)
        self.arm = JointTrajectoryController("arm", self.settings, [ARM_LIMITS] * 2, JOINTS, self.manager.cycle.settled)
        self.hand = ForwardCommandController("hand", (HAND,), (HAND_LIMITS,), JOINTS)
        for controller in (self.arm, self.hand):
            self.manager.registry.add(self.wrap(controller))
        self.loop = ControlLoop(components, self.manager, LIMITS, self.clock, PERIOD_S)

    def up(self) -> "Bench":
        """Configure and activate the hardware with all joints at rest at zero."""
        self.hardware.configure()
        self.loop.activate()
        return self

    def cycle(self, count: int = 1) -> None:
        """Run cycles at the rate of the loop."""
        for _ in range(count):
            self.clock.sleep_until(self.clock.now() + PERIOD_S)
            self.loop.step()

    def cycles_until(self, done: Callable[[], bool], longest: int = 400) -> int:
        """Run cycles until ``done`` returns True. Return their number."""
        for count in range(longest):
            if done():
                return count
            self.cycle()
        raise AssertionError(f"not within {longest} cycles")

    def send(self, goal: TrajectoryGoal) -> GoalHandle:
        """Submit a goal that must be accepted."""
        assert self.arm.check(goal) is None
        return self.arm.submit(goal)

    def path(self) -> FloatArray:
        """Return all written commands, shape (cycles, joints)."""
        return np.array(self.hardware.written)

    @property
    def velocity(self) -> FloatArray:
        """Current velocity of the reference."""
        assert self.arm.tracking is not None
        return self.arm.tracking.reference.velocity


def to(
    *position: float,
    after_s: float = 1.0,
    path: Mapping[str, float] | None = None,
    goal: Mapping[str, float] | None = None,
    goal_time_s: float = 0.0,
    delay_s: float = 0.0,
) -> TrajectoryGoal:
    """Return a goal with one point."""
    tolerances = Tolerances(path or {}, goal or {}, goal_time_s)
    return TrajectoryGoal(ARM, (GoalPoint(tuple(position), after_s),), tolerances, delay_s)


def through(*points: GoalPoint, delay_s: float = 0.0) -> TrajectoryGoal:
    """Return a goal with several points."""
    return TrajectoryGoal(ARM, points, delay_s=delay_s)
