"""Move joints through the controllers of a stack, as its ROS interface does."""

import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from typing import Any, Final, cast

from controller.action_goals import GoalStatus
from controller.forward.forward_command_controller import (
    ForwardCommandController,
    JointGroupEffortController,
    JointGroupPositionController,
    JointGroupVelocityController,
)
from controller.gripper.goal import GripperGoal, GripperHandle
from controller.gripper.gripper_action_controller import GripperActionController, PositionGripperActionController
from controller.loop import ControlLoop
from controller.manager.switch import Loaded, SwitchRequest
from controller.trajectory.goal import GoalHandle, GoalPoint, TrajectoryGoal
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from hal.types import joints_of
from servoloop.command_socket.command_errors import CommandError

TRAJECTORY: Final = (JointTrajectoryController.kind,)
GRIPPER: Final = (GripperActionController.kind, PositionGripperActionController.kind)
FORWARD: Final = tuple(
    kind.kind
    for kind in (
        ForwardCommandController,
        JointGroupPositionController,
        JointGroupVelocityController,
        JointGroupEffortController,
    )
)


@dataclass(frozen=True, slots=True)
class _RunningGoal:
    """Unfinished goal of a client."""

    controller: Any
    handle: GoalHandle | GripperHandle


@dataclass(slots=True)
class _ClientMotions:
    """Motions of one client."""

    goals: dict[int, _RunningGoal] = field(default_factory=dict)
    """Goals, keyed by goal number."""
    set_points: dict[str, _RunningGoal | None] = field(default_factory=dict)
    """Latest set point of each controller, keyed by controller name; the value is None for a forward controller."""


class Motions:
    """Goals and streams of all clients of the command socket. Any thread may call each method."""

    def __init__(self, loop: ControlLoop) -> None:
        self._loop = loop
        self._lock = threading.RLock()
        self._clients: dict[object, _ClientMotions] = {}
        self._numbers = count(1)

    def goal(self, client: object, name: str, joints: Sequence[str], points: Sequence[GoalPoint]) -> int:
        """Send a goal to a trajectory controller, and return the goal number.

        Args:
            client: Client that sends the goal.
            name: Name of the controller, or an empty string for the active controller of these joints.
            joints: Joints of the goal.
            points: Waypoints, in the order of ``joints``.

        Raises:
            CommandError: The controller or a joint is unknown, or the goal is rejected.
        """
        with self._lock:
            entry = self._entry(name, TRAJECTORY) if name else self._moving(joints)
            _require_known(joints, entry)
            started = self._submit(entry, TrajectoryGoal(tuple(joints), tuple(points)))
            return self._add(client, started)

    def grip(self, client: object, name: str, goal: GripperGoal) -> int:
        """Send a goal to a gripper controller, and return the goal number. Raises the same errors as ``goal``."""
        with self._lock:
            controller: GripperActionController = cast(Any, self._entry(name, GRIPPER).controller)
            if reason := controller.check(goal):
                raise CommandError("rejected", reason)
            return self._add(client, _RunningGoal(controller, controller.submit(goal)))

    def set_point(self, client: object, name: str, values: Sequence[float], time_s: float) -> None:
        """Send one set point of a stream.

        Args:
            client: Client that sends the set point.
            name: Name of a forward or trajectory controller, or an empty string for the only active one.
            values: One value for each joint of the controller.
            time_s: Time until a trajectory controller comes to rest at the set point, in seconds.

        Raises:
            CommandError: The controller is unknown or inactive, or it rejects the set point.
        """
        with self._lock:
            entry = self._entry(name, (*TRAJECTORY, *FORWARD))
            motions = self._clients.setdefault(client, _ClientMotions())
            if entry.spec.kind in TRAJECTORY:
                points = (GoalPoint(tuple(values), time_s),)
                goal = TrajectoryGoal(_joints(entry), points, from_topic=True)
                motions.set_points[entry.name] = self._submit(entry, goal)
                return
            if not entry.active:
                raise CommandError("rejected", f"{name} is not active: activate the controller first")
            if reason := cast(Any, entry.controller).submit(list(values)):
                raise CommandError("rejected", reason)
            motions.set_points[entry.name] = None

    def cancel(self, client: object, number: int) -> None:
        """Cancel a goal of a client. A goal that has just finished is not affected. Raises CommandError."""
        with self._lock:
            goals = self._clients.get(client, _ClientMotions()).goals
            if number not in goals:
                running = ", ".join(map(str, goals)) or "none"
                raise CommandError("unknown", f"this client has no running goal {number}; running goals: {running}")
            goals[number].controller.cancel(goals[number].handle)

    def halt(self, client: object) -> None:
        """Stop the motions of a client: cancel its goals, and hold the joints of its streams."""
        with self._lock:
            motions = self._clients.get(client, _ClientMotions())
            for goal in (*motions.goals.values(), *filter(None, motions.set_points.values())):
                goal.controller.cancel(goal.handle)
            for name in (name for name, goal in motions.set_points.items() if goal is None):
                self._hold(self._loop.manager.registry.loaded.get(name))
            motions.set_points.clear()

    def stop(self) -> None:
        """Cancel the goals of all clients, including ROS clients, and hold the joints of all streams."""
        with self._lock:
            for client in self._clients:
                self.halt(client)
            for entry in self._loop.manager.registry.loaded.values():
                newest = getattr(entry.controller, "newest_goal", None)
                if newest is not None and not newest.done:
                    cast(Any, entry.controller).cancel(newest)
                self._hold(entry)

    def ended(self, client: object) -> Iterator[dict[str, Any]]:
        """Yield, as an event, the result of each of a client's goals that has finished since the last call."""
        if client not in self._clients:
            return
        with self._lock:
            goals = self._clients[client].goals
            for number in [number for number, goal in goals.items() if goal.handle.done]:
                yield _result(number, goals.pop(number).handle)

    def forget(self, client: object) -> None:
        """Discard the data of a client that has disconnected. Call ``halt`` first."""
        with self._lock:
            self._clients.pop(client, None)

    def busy(self, client: object, entry: Loaded) -> bool:
        """Return whether a controller is executing a goal of another client or of a ROS client."""
        newest = getattr(entry.controller, "newest_goal", None)
        if newest is None or newest.done:
            return False
        motions = self._clients.get(client, _ClientMotions())
        own = (*motions.goals.values(), *filter(None, motions.set_points.values()))
        return all(goal.handle is not newest for goal in own) and not getattr(newest.goal, "from_topic", False)

    def _hold(self, entry: Loaded | None) -> None:
        """Bring the joints of an active forward controller to rest within their limits, and hold them."""
        if entry is None or not entry.active or entry.spec.kind not in FORWARD:
            return
        controller, loop = cast(Any, entry.controller), self._loop
        if getattr(controller.parameters, "interface_name", "position") != "position":
            controller.submit([0.0] * len(controller.command))
        elif not controller.settled():
            restart = SwitchRequest(activate=(entry.name,), deactivate=(entry.name,))
            loop.requests.ask(lambda: loop.manager.switch(restart, loop.within_limits))

    def _submit(self, entry: Loaded, goal: TrajectoryGoal) -> _RunningGoal:
        controller: JointTrajectoryController = cast(Any, entry.controller)
        goal = self._timed(controller, goal)
        if reason := controller.check(goal):
            raise CommandError("rejected", reason)
        return _RunningGoal(controller, controller.submit(goal))

    def _timed(self, controller: JointTrajectoryController, goal: TrajectoryGoal) -> TrajectoryGoal:
        """Return the goal with the time of the next cycle, as estimated from the latest cycle."""
        tracking, now_s = controller.tracking, self._loop.clock.now()
        if tracking is None:
            return goal
        ahead_s = max(tracking.stamp_s + controller.period_s - now_s, 0.0)
        return replace(goal, next_cycle_s=ahead_s, begins_s=now_s + ahead_s)

    def _add(self, client: object, goal: _RunningGoal) -> int:
        number = next(self._numbers)
        self._clients.setdefault(client, _ClientMotions()).goals[number] = goal
        return number

    def _entry(self, name: str, kinds: Sequence[str]) -> Loaded:
        """Return the named controller if it is configured and has one of these types, or the only active one if the
        name is empty."""
        loaded = {n: e for n, e in self._loop.manager.registry.loaded.items() if e.spec.kind in kinds and e.controller}
        found = [entry for entry in loaded.values() if (entry.name == name if name else entry.active)]
        if len(found) == 1:
            return found[0]
        known = ", ".join(loaded) or "none"
        text = f"there is no controller {name}" if name else "no controller is specified"
        raise CommandError("unknown", f"{text}; the controllers for this message are: {known}")

    def _moving(self, joints: Sequence[str]) -> Loaded:
        """Return the active trajectory controller that drives all of these joints."""
        active = [
            entry
            for entry in self._loop.manager.registry.loaded.values()
            if entry.active and entry.spec.kind in TRAJECTORY
        ]
        for entry in active:
            if set(joints) <= set(_joints(entry)):
                return entry
        has = "; ".join(f"{entry.name}: {', '.join(_joints(entry))}" for entry in active) or "none is active"
        raise CommandError("unknown", f"no active trajectory controller moves {', '.join(joints)} ({has})")


def _require_known(joints: Sequence[str], entry: Loaded) -> None:
    if unknown := [joint for joint in joints if joint not in _joints(entry)]:
        has = ", ".join(_joints(entry))
        raise CommandError("unknown", f"{entry.name} does not move {', '.join(unknown)}; it moves {has}")


def _joints(entry: Loaded) -> tuple[str, ...]:
    """Return the joints of a controller, in the order of its commands."""
    return tuple(dict.fromkeys(joints_of(entry.commands)))


def _result(number: int, handle: GoalHandle | GripperHandle) -> dict[str, Any]:
    """Return the result of a goal as an event."""
    status = handle.status.value
    event = {"event": "result", "goal": number, "status": status, "ok": handle.status is GoalStatus.SUCCEEDED}
    if isinstance(handle, GoalHandle):
        return {**event, "code": int(handle.error_code), "text": handle.error_text}
    return {**event, "text": handle.text, "position": handle.state.position, "stalled": handle.state.stalled}
