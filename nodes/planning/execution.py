"""Execute trajectories with the controllers of the stack, and stop them if the scene changes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

from moveit_msgs.msg import RobotTrajectory
from rclpy.node import Node
from rclpy.task import Future
from trajectory_msgs.msg import JointTrajectory

from drivers.printable import printable_line
from nodes.planning.controllers import RouteController, StopRequest
from nodes.planning.conversion.trajectories import checked_points, part, timed_path
from nodes.planning.request_errors import REFUSALS, RequestError
from nodes.planning.requests import Snapshot
from nodes.planning.workers import Workers
from nodes.planning.world_store import WorldStore
from planning.group_planner import GroupPlanner
from planning.groups import Group
from planning.motion import FutureContact
from planning.paths.timing import TimedPath
from planning.robot import PlanningRobot

START_RAD: Final = 0.05
"""Maximum distance of a joint from the start of a trajectory, in rad or m."""
LAG_S: Final = 0.5
"""Maximum delay of the arm relative to its trajectory, in seconds."""
INVALIDATED: Final = "MOTION_PLAN_INVALIDATED_BY_ENVIRONMENT_CHANGE"
"""Error code of a motion that was stopped because the scene changed."""


@dataclass(eq=False)
class Running:
    """A motion that is being executed."""

    path: TimedPath
    """The motion of all driven joints."""
    stop: StopRequest
    begun_s: float
    """Time on the node's clock when the motion started, in seconds."""
    names: tuple[str, ...]
    """Names of the controllers that execute the motion."""
    is_monitored: bool = True
    """Whether scene changes stop the motion. A motion that already touches an object when it starts is not
    monitored."""
    is_checked: bool = False
    """Whether the remainder of the motion is being checked against the scene."""
    is_outdated: bool = False
    """Whether the scene has changed since the current check began."""


class Execution:
    """Executor of trajectories. Motions of different controllers may run at the same time."""

    def __init__(self, node: Node, robot: PlanningRobot, store: WorldStore, workers: Workers) -> None:
        self._node = node
        self._robot = robot
        self._store = store
        self._workers = workers
        self._log = node.get_logger()
        self._all = GroupPlanner(robot.model, robot.limits, Group("all joints", tuple(robot.limits)))
        self._running: list[Running] = []
        self.controllers: Mapping[str, RouteController] = {}
        """Controllers of the stack, keyed by name."""
        self.idle = Future()
        """Future that is done when all motions have stopped after ``stop_all``."""
        store.listeners.append(self._check_all)

    @property
    def is_idle(self) -> bool:
        """Whether no motion is running."""
        return not self._running

    def stop_all(self, code: str, message: str) -> None:
        """Stop all motions."""
        for running in self._running:
            running.stop.request(code, message)

    async def run(
        self, trajectory: RobotTrajectory, names: Sequence[str], stop: StopRequest, *, must_be_free: bool = False
    ) -> None:
        """Execute a trajectory until it ends or is stopped.

        Args:
            trajectory: The trajectory.
            names: Controllers to use; if empty, the controllers of the joints.
            stop: Request that stops the motion.
            must_be_free: Whether to reject a trajectory that touches an object in the current scene. If False, the
                trajectory is executed, as in MoveIt, and scene changes do not stop it.

        Raises:
            RequestError: The trajectory is invalid, was stopped, or was not executed.
        """
        message = trajectory.joint_trajectory
        if trajectory.multi_dof_joint_trajectory.joint_names:
            raise RequestError(
                "INVALID_MOTION_PLAN",
                "multi-DOF trajectories are not supported, because the robot has no multi-DOF joint: send joint "
                "trajectories",
            )
        checked_points(message)
        chosen = self._chosen(message, names)
        now = await self._store.snapshot()
        self._check_start(message, now)
        order = tuple(self._robot.limits)
        path = timed_path(message, order, [now.state[joint] for joint in order])
        running = Running(path, stop, self._now_s(), tuple(one.route.name for one in chosen))
        self._running.append(running)
        try:
            await self._check_first(running, now, must_be_free)
            stop.check()
            running.begun_s = self._now_s()
            await self._follow(message, chosen, stop)
        finally:
            self._running.remove(running)
            if not self._running and not self.idle.done():
                self.idle.set_result(None)

    async def _follow(self, message: JointTrajectory, chosen: Sequence[RouteController], stop: StopRequest) -> None:
        executor = self._node.executor
        ends = [executor.create_task(self._follow_one, one, message, stop) for one in chosen]
        reasons = [await end for end in ends]
        stop.check()
        if reason := next(filter(None, reasons), ""):
            raise RequestError("CONTROL_FAILED", reason)

    async def _follow_one(self, controller: RouteController, message: JointTrajectory, stop: StopRequest) -> str:
        own = [joint for joint in message.joint_names if joint in controller.route.joints]
        try:
            reason = await controller.follow(part(message, own), stop)
        except RequestError as error:
            reason = str(error)
        if reason and not stop.requested:
            stop.request("CONTROL_FAILED", reason)  # This also stops the other controllers.
        return reason

    def _chosen(self, message: JointTrajectory, names: Sequence[str]) -> list[RouteController]:
        """Return the controllers for the joints of a trajectory. Raises RequestError."""
        for name in names:
            if name not in self.controllers:
                known = ", ".join(self.controllers)
                raise RequestError("CONTROL_FAILED", f"there is no controller {name}: choose from {known}")
        usable = [one for name, one in self.controllers.items() if not names or name in names]
        followers = {name for name, joint in self._robot.description.joints.items() if joint.mimic is not None}
        chosen: list[RouteController] = []
        for joint in message.joint_names:
            owner = next((one for one in usable if joint in one.route.joints), None)
            if owner is None and joint not in followers:
                raise RequestError(
                    "CONTROL_FAILED", f"no controller moves {joint}: use only joints of {self._moved(usable)}"
                )
            if owner is not None and owner not in chosen:
                chosen.append(owner)
        busy = {name for running in self._running for name in running.names}
        if taken := [one.route.name for one in chosen if one.route.name in busy]:
            raise RequestError(
                "CONTROL_FAILED", f"{taken[0]} is executing another motion: wait until the motion ends, or cancel it"
            )
        return chosen

    def _moved(self, usable: Sequence[RouteController]) -> str:
        return ", ".join(joint for one in usable for joint in one.route.joints)

    def _check_start(self, message: JointTrajectory, now: Snapshot) -> None:
        """Check that the arm is at the start of the trajectory. Otherwise, the arm would jump to the start.

        This check is skipped for a trajectory with one point or with a first point after time 0, because such a
        trajectory has no start.
        """
        first = message.points[0]
        if len(message.points) == 1 or first.time_from_start.sec or first.time_from_start.nanosec:
            return
        for joint, position in zip(message.joint_names, first.positions, strict=True):
            at = now.state.get(joint, position)
            if abs(at - position) > START_RAD:
                raise RequestError(
                    "CONTROL_FAILED",
                    f"the trajectory begins with {joint} at {position:.3f}, but the joint is at {at:.3f}: plan again",
                )

    async def _check_first(self, running: Running, now: Snapshot, must_be_free: bool) -> None:
        """Check a motion against the scene before the motion begins. Raises RequestError."""
        contact = await self._workers.compute(partial(self._contact, running, now, 0.0))
        if contact is None:
            return
        text = f"{contact.one} would touch {contact.other}"
        if must_be_free:
            raise RequestError(INVALIDATED, f"the scene has changed, and {text}: the arm has not moved")
        running.is_monitored = False
        self._log.warning(
            printable_line(f"{text} on this trajectory, so the motion is not monitored: scene changes will not stop it")
        )

    def _check_all(self) -> None:
        """Check the remainder of each motion against the changed scene."""
        for running in self._running:
            running.is_outdated = True
            if running.is_monitored and not running.is_checked:
                running.is_checked = True
                self._node.executor.create_task(self._check, running)

    async def _check(self, running: Running) -> None:
        try:
            while running.is_outdated and running in self._running and not running.stop.requested:
                running.is_outdated = False
                now = await self._store.snapshot()
                contact = await self._workers.compute(
                    partial(self._contact, running, now, self._now_s() - running.begun_s - LAG_S)
                )
                if contact is not None:
                    text = f"{contact.one} would touch {contact.other}: the motion stops along its path"
                    self._log.warning(printable_line(f"the scene has changed, and {text}"))
                    running.stop.request(INVALIDATED, f"the scene has changed, and {text}")
        except REFUSALS as error:
            self._log.error(printable_line(f"the motion stops, because the rest of it cannot be checked: {error}"))
            running.stop.request(INVALIDATED, f"the rest of the motion cannot be checked: {error}")
        finally:
            running.is_checked = False

    def _contact(self, running: Running, now: Snapshot, from_s: float) -> FutureContact | None:
        return self._all.future_contact(running.path, from_s, now.state, now.world.scene)

    def _now_s(self) -> float:
        return float(self._node.get_clock().now().nanoseconds) * 1e-9
