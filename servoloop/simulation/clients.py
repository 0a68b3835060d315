"""Simulated clients, which perform the actions of a schedule between cycles."""

import logging
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, Final, Protocol

import numpy as np

from controller.guided_motion import HORIZON_S, GuidedMotion, JointPositions
from controller.manager.client import ManagerClient
from controller.manager.switch import Strictness, SwitchRequest
from controller.manager_errors import ManagerError
from controller.motion import Kinematics, MotionError, motion_to
from controller.trajectory.goal import GoalPoint, TrajectoryGoal
from controller.trajectory.parameters import TrajectoryParameters
from controller.trajectory.tolerances import Tolerances
from drivers.driver_errors import DriverError
from hal.hal_errors import HalError
from hal.hardware import Reactivating
from hal.lifecycle import LifecycleState
from hal.types import FloatArray, JointFault, JointLimits, JointState
from servoloop.simulation.acts import (
    Act,
    Cancel,
    Configure,
    FollowPlan,
    FollowWaypoints,
    Grip,
    GuideArm,
    Jog,
    Move,
    MoveHand,
    Reactivate,
    ScaleSpeed,
    SocketAct,
    Stream,
    Switch,
)
from servoloop.simulation.grips import GripperClient
from servoloop.simulation.stack import SimulatedStack

LOG = logging.getLogger("servoloop")

TABLE_S: Final = 0.1
"""Time between two points of a planner's trajectory, in seconds."""
AHEAD_S: Final = 0.2
"""``time_from_start`` of each streamed point, in seconds."""
JOG_SHARE: Final = 0.3
"""Maximum jogging velocity, as a fraction of the velocity limit."""
PULL_SHARE: Final = 0.5
"""Maximum pull by hand, as a fraction of the servo's full effort."""
LOOKS_S: Final = 0.25
"""Time after which a client checks again whether a joint is limp, in seconds."""
PUSHED_S: Final = 0.3
"""Duration for which a hand pushes limp joints, in seconds."""


class HandGuidance(Protocol):
    """Interface to the freedrive of a stack."""

    def begin(self) -> None:
        """Let a person move the joints by hand. Raises DriverError."""
        ...

    def end(self) -> None:
        """Make the joints hold their positions."""
        ...

    def update(self, faults: Mapping[str, JointFault], now_s: float) -> None:
        """Update the freedrive after a cycle in which the joints in ``faults`` were not measured."""
        ...


class SocketPrograms(Protocol):
    """Programs that are connected to the command socket of a stack."""

    @property
    def last_target_s(self) -> float:
        """Time of the latest target of a stream, in seconds, or minus infinity before the first stream."""
        ...

    @property
    def owner(self) -> str:
        """Name of the program that has control of the arm, or an empty string if there is no such program."""
        ...

    @property
    def dead_owner(self) -> str:
        """Name of a program that has died but still has control of the arm, or an empty string if there is no such
        program."""
        ...

    def carry_out(self, act: SocketAct) -> None:
        """Perform an action."""
        ...

    def cycle(self) -> None:
        """Continue all programs after a cycle."""
        ...

    def die(self) -> None:
        """Close all connections, as if the programs had been killed."""
        ...


class SimulatedClients:
    """Simulated clients that perform the actions in ``acts`` on an active stack. Call ``cycle`` after each control
    cycle."""

    def __init__(
        self,
        stack: SimulatedStack,
        arm: Any,
        acts: tuple[Act, ...],
        freedrive: HandGuidance,
        programs: SocketPrograms | None = None,
    ) -> None:
        """Connect clients to a stack.

        Args:
            stack: The stack.
            arm: Trajectory controller that receives the goals.
            acts: Actions of the clients.
            freedrive: Freedrive of the stack, for actions that move joints by hand.
            programs: Programs that perform the actions on the command socket; required if ``acts`` contains such
                actions.
        """
        self.programs = programs
        """Programs on the command socket, if there are any."""
        self._stack, self._arm, self._freedrive = stack, arm, freedrive
        self._since_s = stack.clock.now()
        self._due: list[tuple[float, Callable[[], None]]] = [(act.at_s, self._action(act)) for act in acts]
        self._due.sort(key=lambda one: one[0])
        self._streams: list[Iterator[None]] = []
        self.half_switched = False
        """Whether an impossible switch was carried out in part."""
        self.speed_factor = 1.0
        """Latest speed scaling factor that a client has requested."""
        self.newest = ""
        """Type of the latest action, or empty before the first action."""
        self._measured: FloatArray = np.full(len(arm.joints), np.nan)
        """Measured positions (n,) of the arm's joints in the latest cycle, in rad or m."""
        self.gripper = GripperClient(stack) if any(isinstance(act, Grip) for act in acts) else None
        """Client of a gripper action controller, or None if no action needs this client."""

    def cycle(self, state: JointState) -> None:
        """Perform all actions that are due."""
        joints = self._stack.loop.hardware.joints
        self._measured = state.position[[joints.index(joint) for joint in self._arm.joints]]
        now_s = self._stack.clock.now() - self._since_s
        while self._due and self._due[0][0] <= now_s:
            self._due.pop(0)[1]()
        self._streams = [stream for stream in self._streams if next(stream, self) is not self]
        self._freedrive.update(state.faults, state.stamp_s)
        if self.programs is not None:
            self.programs.cycle()

    def die(self) -> None:
        """Cancel all remaining actions, as if the clients had crashed."""
        self._due.clear()
        self._streams.clear()
        if self.programs is not None:
            self.programs.die()

    def _action(self, act: Act) -> Callable[[], None]:
        actions: Mapping[str, Callable[[Any], None]] = {
            "move": self._move,
            "plan": self._plan,
            "waypoints": self._waypoints,
            "stream": self._stream,
            "cancel": self._cancel,
            "hand": self._hand,
            "grip": self._grip,
            "switch": self._switch,
            "configure": self._configure,
            "scale_speed": self._scale_speed,
            "reactivate": self._reactivate,
            "jog": self._jog,
            "guide": self._guide,
        }
        programs = self.programs
        if isinstance(act, SocketAct):
            assert programs is not None, "no programs are connected to the command socket"
            actions = {act.kind: programs.carry_out}

        def do() -> None:
            self.newest = act.kind
            try:
                actions[act.kind](act)
            except (DriverError, HalError, ManagerError, MotionError) as error:
                LOG.info("a simulated client's request was rejected: %s", error)

        return do

    def _later(self, after_s: float, action: Callable[[], None]) -> None:
        self._due.append((self._stack.clock.now() - self._since_s + after_s, action))
        self._due.sort(key=lambda one: one[0])

    def _move(self, act: Move) -> None:
        each = dict.fromkeys(self._arm.joints, act.tolerance) if act.tolerance else {}
        point = GoalPoint(self._all(act.positions), act.seconds)
        goal = TrajectoryGoal(self._arm.joints, (point,), Tolerances({} if act.at_end else each, each, act.goal_time_s))
        if act.partial:
            goal = _of_joints(goal, set(act.positions))
        self._send(_reversed(goal) if act.mixed else goal)

    def _plan(self, act: FollowPlan) -> None:
        limits = [_scaled(limit, act.scale) for limit in self._limits()]
        here = np.clip(self._here(), [one.lower for one in limits], [one.upper for one in limits])
        motion = motion_to(
            Kinematics.at_rest(here), Kinematics.at_rest(np.array(self._all(act.positions))), limits, 0.0
        )
        times_s = [*np.arange(TABLE_S, motion.duration_s, TABLE_S).tolist(), max(motion.duration_s, TABLE_S / 2.0)]
        goal = TrajectoryGoal(self._arm.joints, tuple(_point(motion.sample(time_s), time_s) for time_s in times_s))
        self._send(_reversed(goal) if act.mixed else goal)

    def _waypoints(self, act: FollowWaypoints) -> None:
        names = tuple(dict.fromkeys((*act.points[0], *self._arm.joints)))
        here, points = dict(zip(self._arm.joints, self._here().tolist(), strict=True)), []
        for number, positions in enumerate(act.points, 1):
            here |= positions
            points.append(GoalPoint(tuple(here[name] for name in names), number * act.seconds))
        self._send(TrajectoryGoal(names, tuple(points), delay_s=act.delay_s))

    def _stream(self, act: Stream) -> None:
        self._streams.append(self._points(act))

    def _points(self, act: Stream) -> Iterator[None]:
        start, goal = self._here(), np.array(self._all(act.positions))
        begun_s = self._stack.clock.now()
        while (share := (self._stack.clock.now() - begun_s + AHEAD_S) / (act.for_s + AHEAD_S)) < 1.0:
            point = GoalPoint(tuple((start + share * (goal - start)).tolist()), AHEAD_S)
            self._send(TrajectoryGoal(self._arm.joints, (point,), from_topic=True))
            yield
            yield

    def _jog(self, act: Jog) -> None:
        self._streams.append(self._jogged(act))

    def _jogged(self, act: Jog) -> Iterator[None]:
        limits, period_s = self._limits(), 2.0 * self._stack.loop.period_s
        lower, upper = np.array([(one.lower, one.upper) for one in limits]).T
        fastest = np.array([JOG_SHARE * one.velocity for one in limits])
        motion = GuidedMotion(self._here(), lower, upper, fastest)
        velocity = np.where(np.array(self._arm.joints) == act.joint, act.share * fastest, 0.0)
        end_s = self._stack.clock.now() + act.for_s
        while self._stack.clock.now() < end_s and np.isfinite(self._measured).all():
            set_point = motion.go(velocity, period_s, JointPositions(self._here(), self._measured))
            point = GoalPoint(tuple(set_point.tolist()), HORIZON_S)
            self._send(TrajectoryGoal(self._arm.joints, (point,), from_topic=True))
            yield
            yield

    def _guide(self, act: GuideArm) -> None:
        stack, freedrive = self._stack, self._freedrive
        freedrive.begin()
        joint = next(one for one in stack.files.robot.joints if one.name == act.joint)
        pull = act.share * PULL_SHARE * joint.full_effort
        stack.world.load(act.joint, pull)

        def release() -> None:
            stack.world.load(act.joint, -pull)
            freedrive.end()

        self._later(act.for_s, release)

    def _cancel(self, act: Cancel) -> None:
        if self._arm.newest is not None:
            self._arm.cancel(self._arm.newest)

    def _hand(self, act: MoveHand) -> None:
        limit = self._limit_of(self._stack.hand.joints[0])
        self._stack.hand.submit([limit.lower + act.share * (limit.upper - limit.lower)])

    def _grip(self, act: Grip) -> None:
        assert self.gripper is not None, "no controller was added for this action"
        goal, gripper = self.gripper.grip(act), self.gripper
        if goal is not None and act.cancel_after_s > 0.0:
            self._later(act.cancel_after_s, lambda: gripper.cancel(goal))

    def _switch(self, act: Switch) -> None:
        name, loop = self._stack.hand.name if act.hand else self._arm.name, self._stack.loop
        if act.impossible:
            self._switch_impossible(name)
            return
        loop.manager.switch(SwitchRequest(deactivate=(name,)), loop.within_limits)
        self._later(act.for_s, lambda: self._activate(name))

    def _switch_impossible(self, name: str) -> None:
        """Request a strict switch that must be rejected."""
        loop = self._stack.loop
        loop.manager.switch(SwitchRequest(("unknown_controller",), (name,), Strictness.STRICT), loop.within_limits)
        self.half_switched = True

    def _configure(self, act: Configure) -> None:
        stack, name = self._stack, self._arm.name
        if self._arm.newest is not None and not self._arm.newest.done:
            return
        values = self._arm.parameters.model_dump()
        constraints, values["allow_partial_joints_goal"] = values["constraints"], act.partial
        constraints["goal_time"] = act.goal_time_s or constraints["goal_time"]
        for joint in self._arm.joints:
            constraints[joint]["trajectory"] = act.path_tolerance or constraints[joint]["trajectory"]
            constraints[joint]["goal"] = act.goal_tolerance or constraints[joint]["goal"]
        client = ManagerClient(stack.loop, stack.control_stack.factory)
        client.change(name, TrajectoryParameters.model_validate(values))

    def _scale_speed(self, act: ScaleSpeed) -> None:
        self._arm.scaling.ask(act.factor)
        self.speed_factor = act.factor

    def _activate(self, *names: str) -> None:
        loop = self._stack.loop
        for name in names:
            try:
                loop.manager.switch(SwitchRequest(activate=(name,)), loop.within_limits)
            except ManagerError as error:
                LOG.info("a simulated client's request was rejected: %s", error)

    def _reactivate(self, act: Reactivate) -> None:
        loop = self._stack.loop
        running = [one.spec.name for one in loop.manager.registry.running if one.controller.command_interfaces]
        transitions, components = loop.component_transitions, [one.name for one in loop.hardware.components]

        def activate() -> None:
            for name in components:
                self._stack.activations.append(transitions.ask(name, LifecycleState.ACTIVE))

        def activate_all() -> None:
            activate()
            self._later(2.0 * loop.period_s, lambda: self._activate(*running))

        def push(limp: Collection[str]) -> None:
            self._push(limp, act.push, PUSHED_S)
            self._later(PUSHED_S, activate)

        if act.for_s == 0.0:
            self._when_limp(push)
            return
        for name in components:
            transitions.ask(name, LifecycleState.INACTIVE, act.relax)
        if act.relax:
            self._push(loop.hardware.joints, act.push, act.for_s / 2.0)
        self._later(act.for_s, activate_all)

    def _when_limp(self, action: Callable[[Collection[str]], None]) -> None:
        """Call ``action`` with the names of the limp joints of the active hardware, as soon as there are any."""
        parts = [one.hardware for one in self._stack.loop.hardware.components if one.active]
        limp = {name for part in parts if isinstance(part, Reactivating) for name in part.without_torque}
        if limp:
            action(limp)
        else:
            self._later(LOOKS_S, lambda: self._when_limp(action))

    def _push(self, limp: Collection[str], share: float, for_s: float) -> None:
        """Push limp joints, as a person may do before an activation."""
        stack = self._stack
        for joint in stack.files.robot.joints:
            if joint.name in limp and share:
                pull = share * PULL_SHARE * joint.full_effort
                stack.world.load(joint.name, pull)
                self._later(for_s, partial(stack.world.load, joint.name, -pull))

    def _send(self, goal: TrajectoryGoal) -> None:
        if self._arm.check(goal) is None:
            self._arm.submit(goal)

    def _here(self) -> Any:
        """Return the commands (n,) of the arm's joints, in rad or m. A planner starts from the commanded position."""
        loop = self._stack.loop
        return loop.command[[self._names().index(joint) for joint in self._arm.joints]]

    def _all(self, positions: Mapping[str, float]) -> tuple[float, ...]:
        return tuple(positions.get(name, here) for name, here in zip(self._arm.joints, self._here(), strict=True))

    def _names(self) -> list[str]:
        return [name.rpartition("/")[0] for name in self._stack.loop.hardware.command_interfaces]

    def _limit_of(self, joint: str) -> JointLimits:
        return self._stack.loop.limits[self._names().index(joint)]

    def _limits(self) -> list[JointLimits]:
        return [self._limit_of(joint) for joint in self._arm.joints]


def _point(state: Kinematics, time_s: float) -> GoalPoint:
    return GoalPoint(
        tuple(state.position.tolist()), time_s, tuple(state.velocity.tolist()), tuple(state.acceleration.tolist())
    )


def _reversed(goal: TrajectoryGoal) -> TrajectoryGoal:
    """Return the same goal with its joints in reverse order."""
    points = tuple(
        replace(
            one, positions=one.positions[::-1], velocities=one.velocities[::-1], accelerations=one.accelerations[::-1]
        )
        for one in goal.points
    )
    return replace(goal, joints=goal.joints[::-1], points=points)


def _of_joints(goal: TrajectoryGoal, joints: Collection[str]) -> TrajectoryGoal:
    """Return the part of a goal with one point that moves these joints."""
    point = goal.points[0]
    kept = [(name, at) for name, at in zip(goal.joints, point.positions, strict=True) if name in joints]
    return replace(
        goal, joints=tuple(name for name, _ in kept), points=(replace(point, positions=tuple(at for _, at in kept)),)
    )


def _scaled(limit: JointLimits, scale: float) -> JointLimits:
    return JointLimits(limit.lower, limit.upper, limit.velocity * scale, limit.acceleration, limit.jerk)
