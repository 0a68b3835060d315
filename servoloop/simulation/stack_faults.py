"""Inject faults above the servos: a stalled computer, a faulty controller or a faulty client."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from operator import attrgetter
from pathlib import Path
from random import Random
from typing import Any, Final, TypeVar

import numpy as np

from controller.interface import Controller
from controller.trajectory.goal import GoalHandle, GoalPoint, TrajectoryGoal
from drivers.clock import Clock
from drivers.servos.catalog import series_of
from drivers.servos.register import ServoModel
from hal.types import FloatArray, JointState
from hal.yaml_nodes import compose
from servoloop.simulation.goal_log import GoalLog
from servoloop.stack.robot_files import Files, ServoFiles
from sim_backend.faults.events import FaultEvent
from sim_backend.faults.fault_error import FaultError
from sim_backend.faults.player import require_possible
from sim_backend.faults.targets import HOLD_S, ClientFault, ControllerFault, Inventory

Result = TypeVar("Result")

ACTIVATED_S: Final = {"feetech": 0.0063, "dynamixel": 0.0169}
"""Time to configure and activate one servo, in seconds, keyed by make."""

GOAL_ATTRIBUTES: Final = ("joints", "check", "submit", "cancel", "parameters.tolerances")
"""Attributes that identify a controller that accepts trajectory goals."""


def inventory_of(files: ServoFiles) -> Inventory:
    """Return the servos and the controllers of an arm.

    Buses and controllers are sorted by name, so that a seed produces the same faults regardless of the order in the
    files.
    """
    robot = files.robot
    servos: dict[str, dict[int, ServoModel]] = {name: {} for name in sorted(robot.file.lines())}
    for joint in robot.joints:
        servos[joint.bus][joint.servo_id] = joint.model
    specs = files.controllers.controllers if isinstance(files, Files) else ()
    controllers = {spec.name: bool(spec.parameters.claims()) for spec in sorted(specs, key=lambda spec: spec.name)}
    start_s = sum(ACTIVATED_S[series_of(joint.model).make] for joint in robot.joints)
    return Inventory(servos, controllers=controllers, start_s=start_s, end_s=HOLD_S + _parking_s(files))


def _parking_s(files: ServoFiles) -> float:
    """Return the maximum time that parking can take in seconds, or 0 if the robot file makes the arm hold its
    position."""
    park = files.robot.file.park
    if park is None or files.robot.file.on_exit.virtual != "relax":
        return 0.0
    limits = {name: files.limits[name] for name in park.pose if name in files.limits}
    durations_s = ((one.upper - one.lower) / (one.velocity * park.velocity_scale) for one in limits.values())
    return max(durations_s, default=0.0)


def require_possible_in(
    path: Path, events: Iterable[FaultEvent], there: Inventory, within: Sequence[str] = ("faults",)
) -> None:
    """Check that the fault events in a file are possible on this arm.

    Args:
        path: Path of the file.
        events: Fault events of the file.
        there: Possible targets.
        within: Keys of the event list in the file.

    Raises:
        FaultError: An event is impossible. The message has the file and line of every impossible event.
    """
    file = compose(path, FaultError)
    require_possible(events, there, lambda number: f"{file.place((*within, number))}: ")


class InjectedError(Exception):
    """Exception that a controller raises because of an injected fault."""


class Upsettable:
    """Wrapper that makes a controller fail on request, and otherwise forwards all calls to the controller."""

    def __init__(self, controller: Controller, goals: GoalLog) -> None:
        self.upsets: list[tuple[ControllerFault, float]] = []
        """Type and command offset of each active fault."""
        self.newest: GoalHandle | None = None
        """Latest goal, if the controller accepts goals that end."""
        self.forwarded: tuple[float, ...] | None = None
        """Latest accepted values, if the controller forwards values to its joints."""
        self.defect: Exception | None = None
        """First exception of the controller that was not injected."""
        self._controller: Any = controller
        self._goals = goals

    def __getattr__(self, name: str) -> Any:
        return getattr(self._controller, name)

    def update(self, state: JointState, now_s: float, period_s: float) -> None:
        if any(how == "raises" for how, _ in self.upsets):
            raise InjectedError("a fault was injected into this controller")
        self._guarded(lambda: self._controller.update(state, now_s, period_s))

    def relieve(self, state: JointState, now_s: float, period_s: float) -> bool:
        return self._guarded(lambda: bool(self._controller.relieve(state, now_s, period_s)))

    def _guarded(self, call: Callable[[], Result]) -> Result:
        """Call a method of the controller, and keep its first exception."""
        try:
            return call()
        except Exception as error:
            self.defect = self.defect or error
            raise

    @property
    def takes_goals(self) -> bool:
        """Whether the controller accepts trajectory goals."""
        try:
            attrgetter(*GOAL_ATTRIBUTES)(self._controller)
        except AttributeError:
            return False
        return True

    def check(self, goal: Any) -> str | None:
        """Return the controller's reason for rejecting a goal, or None. Log refused goals."""
        reason: str | None = self._controller.check(goal)
        if reason is not None:
            self._goals.refused.append((goal, reason))
        return reason

    def submit(self, goal: Any) -> Any:
        """Pass a goal to the controller and log it."""
        answer = self._controller.submit(goal)
        self.newest = answer if isinstance(answer, GoalHandle) else None
        if self.newest is not None:
            self._goals.sent(self._controller.name, goal, self.newest)
        elif answer is None and not isinstance(goal, TrajectoryGoal):
            self.forwarded = tuple(goal)
        return answer

    def activate(self, state: JointState, command: FloatArray) -> None:
        """Activate the controller, which discards the values that it received while it was inactive."""
        self.forwarded = None
        self._controller.activate(state, command)

    def cancel(self, handle: GoalHandle) -> None:
        """Cancel a goal and log the request."""
        self._goals.canceled(handle)
        self._controller.cancel(handle)

    @property
    def command(self) -> FloatArray:
        command: FloatArray = self._controller.command
        for _, offset in self.upsets:
            command = command + offset
        return command


class StackFaults:
    """Target through which a ``FaultPlayer`` injects faults into the computer, the controllers and the arm's client."""

    def __init__(
        self,
        clock: Clock,
        controllers: Mapping[str, Upsettable],
        arm: str,
        client_dies: Callable[[], None],
    ) -> None:
        """Create the target.

        Args:
            clock: The stack's clock.
            controllers: All controllers of the stack, keyed by name.
            arm: Name of the controller whose client misbehaves.
            client_dies: Function that removes the client.
        """
        self.answers: list[str | None] = []
        """One entry for each invalid goal: the reason for its rejection, or None if the goal was accepted."""
        self._clock, self._controllers, self._arm, self._client_dies = clock, controllers, arm, client_dies

    @property
    def controllers(self) -> Mapping[str, bool]:
        """Whether each controller commands joints, keyed by controller name in sorted order."""
        return {name: bool(one.command_interfaces) for name, one in sorted(self._controllers.items())}

    def stall(self, seconds: float) -> None:
        """Stall the thread of the stack."""
        self._clock.sleep_until(self._clock.now() + seconds)

    @contextmanager
    def disturb_controller(self, controller: str | None, how: ControllerFault, jump: float) -> Iterator[None]:
        """Make a controller fail for the duration of the context."""
        upsets, mine = self._controllers[controller or self._arm].upsets, (how, jump)
        upsets.append(mine)
        try:
            yield
        finally:
            upsets.remove(mine)

    def disturb_client(self, kind: ClientFault, random: Random) -> None:
        """Make the client misbehave now."""
        arm = self._controllers[self._arm]
        if kind == "nonsense":
            goal = random.choice(NONSENSE)(arm.joints, random)
            reason = arm.check(goal)
            self.answers.append(reason)
            if reason is None:
                arm.submit(goal)
        elif kind == "dies":
            self._client_dies()
        elif arm.newest is not None:
            arm.cancel(arm.newest)


def _goal(joints: tuple[str, ...], positions: tuple[float, ...]) -> TrajectoryGoal:
    return TrajectoryGoal(joints, (GoalPoint(positions, 1.0),))


def _not_a_number(joints: tuple[str, ...], random: Random) -> TrajectoryGoal:
    positions = [0.0] * len(joints)
    positions[random.randrange(len(joints))] = random.choice([np.nan, np.inf, -np.inf])
    return _goal(joints, tuple(positions))


def _no_such_joint(joints: tuple[str, ...], random: Random) -> TrajectoryGoal:
    return _goal((*joints[:-1], f"joint{random.randrange(1000)}_that_is_not_there"), (0.0,) * len(joints))


def _beyond_the_limits(joints: tuple[str, ...], random: Random) -> TrajectoryGoal:
    return _goal(joints, tuple(random.choice([-1.0, 1.0]) * random.uniform(10.0, 1e9) for _ in joints))


def _too_few(joints: tuple[str, ...], random: Random) -> TrajectoryGoal:
    return _goal(joints, (0.0,) * random.randrange(len(joints)))


def _back_in_time(joints: tuple[str, ...], random: Random) -> TrajectoryGoal:
    still, time_s = (0.0,) * len(joints), random.uniform(0.5, 2.0)
    return TrajectoryGoal(joints, (GoalPoint(still, time_s), GoalPoint(still, time_s - 0.4)))


def _without_joints(joints: tuple[str, ...], random: Random) -> TrajectoryGoal:
    return _goal((), ())


NONSENSE: tuple[Callable[[tuple[str, ...], Random], TrajectoryGoal], ...] = (
    _not_a_number,
    _no_such_joint,
    _beyond_the_limits,
    _too_few,
    _back_in_time,
    _without_joints,
)
"""Functions that create invalid goals, which every arm must reject."""
