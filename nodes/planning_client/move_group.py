"""Client of a move_group node, for use in a command. Every wait has a timeout and ends when a signal arrives."""

from collections.abc import Callable
from dataclasses import dataclass
from time import monotonic
from typing import Any, Final

from moveit_msgs.action import MoveGroup
from moveit_msgs.msg import CollisionObject, MoveItErrorCodes, PlanningScene
from moveit_msgs.srv import ApplyPlanningScene, GetPlanningScene
from rcl_interfaces.srv import GetParameters
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future
from shape_msgs.msg import SolidPrimitive

from drivers.driver_errors import DriverError
from nodes.planning_client.goals import error_text
from nodes.planning_client.scenes import OBJECTS, change, removal

SERVER_S: Final = 5.0
"""Maximum time for a server to appear, in seconds."""
RESPONSE_S: Final = 5.0
CANCEL_S: Final = 5.0
"""Maximum time for the result after a cancel, in seconds."""
EXECUTION_S: Final = 120.0
"""Maximum duration of an execution, in seconds."""
GONE_S: Final = 2.0
"""Minimum time for which the server must be missing before the client stops waiting for its result, in seconds."""
MOVE_ACTION: Final = "move_action"
_SPIN_S: Final = 0.05
_KINDS: Final = {getattr(SolidPrimitive, name): name.lower() for name in ("BOX", "SPHERE", "CYLINDER", "CONE")}
START: Final = "start `servoloop up --plan`, or `servoloop plan-server` alongside a running stack"


class PlannerError(DriverError):
    """Error if no move_group responds, or if move_group rejects a request. The message contains the reason."""


class UserInterruptError(Exception):
    """Error if the user ends the command with a signal."""


@dataclass(frozen=True, slots=True)
class PlannedMotion:
    """Result of a planned motion."""

    planning_time_s: float
    duration_s: float
    points: int


@dataclass(frozen=True, slots=True)
class FoundObject:
    """An object of the planning scene."""

    message: CollisionObject
    link: str = ""
    """Link to which the object is attached, or empty for a world object."""

    def text(self) -> str:
        """Describe the object in one line."""
        item = self.message
        kinds = [_KINDS.get(shape.type, "shape") for shape in item.primitives]
        kinds += ["mesh"] * len(item.meshes) + ["plane"] * len(item.planes)
        shapes = f"{len(kinds)} shapes" if len(kinds) > 1 else "".join(kinds)
        at = item.pose.position
        where = f"{shapes} at {at.x:.3f}, {at.y:.3f}, {at.z:.3f} in {item.header.frame_id}"
        return f"{item.id}: {where}" + (f", attached to {self.link}" if self.link else "")


class MoveGroupClient:
    """Client of move_group. The caller's thread must spin ``executor``, which contains ``node``."""

    def __init__(self, node: Node, executor: SingleThreadedExecutor, stop: Callable[[], bool]) -> None:
        """Create the client. Every wait ends with UserInterruptError when ``stop`` returns True."""
        self._node = node
        self._executor = executor
        self._stop = stop
        self._moves = ActionClient(node, MoveGroup, MOVE_ACTION)

    def descriptions(self) -> tuple[str, str]:
        """Return the URDF and the SRDF of the robot. Raises PlannerError."""
        request = GetParameters.Request(names=["robot_description", "robot_description_semantic"])
        values = self._call(GetParameters, "move_group/get_parameters", request).values
        texts = [value.string_value for value in values]
        if len(texts) != 2 or not all(texts):
            raise PlannerError("move_group has no robot_description or robot_description_semantic: restart move_group")
        return texts[0], texts[1]

    def objects(self) -> list[FoundObject]:
        """Return all objects of the scene, with the attached objects last. Raises PlannerError."""
        scene = self._call(GetPlanningScene, "get_planning_scene", OBJECTS).scene
        world = [FoundObject(item) for item in scene.world.collision_objects]
        return world + [FoundObject(one.object, one.link_name) for one in scene.robot_state.attached_collision_objects]

    def add(self, objects: list[CollisionObject]) -> None:
        """Add objects to the scene. Existing objects of the same names are replaced. Raises PlannerError."""
        self._apply(change(objects))

    def remove(self, name: str) -> None:
        """Remove an object from the world or from the link that holds it. Raises PlannerError if the object does not
        exist."""
        found = [one for one in self.objects() if one.message.id == name]
        if not found:
            known = ", ".join(one.message.id for one in self.objects()) or "none"
            raise PlannerError(f"the scene has no object {name}; its objects: {known}")
        self._apply(removal(name, is_attached=bool(found[0].link)))

    def _apply(self, scene: PlanningScene) -> None:
        response = self._call(ApplyPlanningScene, "apply_planning_scene", ApplyPlanningScene.Request(scene=scene))
        if not response.success:
            raise PlannerError("move_group did not change the scene: see its log for the reason")

    def move(self, goal: MoveGroup.Goal) -> PlannedMotion:
        """Plan a motion and, unless the goal is only to plan, execute it.

        Raises:
            PlannerError: There is no plan, or the execution failed.
            UserInterruptError: The user ended the command. The motion is then canceled.
        """
        action = self._node.resolve_service_name(MOVE_ACTION)
        self._wait_for(self._moves.server_is_ready, action)
        sent = self._moves.send_goal_async(goal)
        self._wait(sent, RESPONSE_S, action)
        handle = sent.result()
        if not handle.accepted:
            raise PlannerError("move_group rejected the goal: see its log for the reason")
        result = handle.get_result_async()
        try:
            self._wait_for_result(result, goal.request.allowed_planning_time + EXECUTION_S)
        except BaseException:
            handle.cancel_goal_async()
            self._spin_until(result.done, CANCEL_S)
            raise
        return _planned(result.result().result)

    def _wait_for_result(self, result: Future, timeout_s: float) -> None:
        end_s = seen_s = monotonic()
        end_s += timeout_s
        while not result.done():
            self._spin()
            seen_s = monotonic() if self._moves.server_is_ready() else seen_s
            if monotonic() - seen_s > GONE_S:
                raise PlannerError("move_group disappeared during the motion: check its log")
            if monotonic() > end_s:
                raise PlannerError(f"the motion did not finish within {timeout_s:.0f} s and is being canceled")

    def _call(self, service: Any, name: str, request: Any) -> Any:
        name = self._node.resolve_service_name(name)
        client = self._node.create_client(service, name)
        try:
            self._wait_for(client.service_is_ready, name)
            future = client.call_async(request)
            self._wait(future, RESPONSE_S, name)
            return future.result()
        finally:
            self._node.destroy_client(client)

    def _wait_for(self, is_ready: Callable[[], bool], name: str) -> None:
        end_s = monotonic() + SERVER_S
        while not is_ready():
            self._spin()
            if monotonic() > end_s:
                raise PlannerError(f"no node provides {name}: {START}")

    def _wait(self, future: Future, timeout_s: float, name: str) -> None:
        end_s = monotonic() + timeout_s
        while not future.done():
            self._spin()
            if monotonic() > end_s:
                raise PlannerError(f"{name} did not respond within {timeout_s:.0f} s: check the log of move_group")

    def _spin_until(self, is_done: Callable[[], bool], timeout_s: float) -> None:
        end_s = monotonic() + timeout_s
        while not is_done() and monotonic() < end_s:
            self._executor.spin_once(timeout_sec=_SPIN_S)

    def _spin(self) -> None:
        self._executor.spin_once(timeout_sec=_SPIN_S)
        if self._stop():
            raise UserInterruptError


def _planned(result: MoveGroup.Result) -> PlannedMotion:
    if result.error_code.val != MoveItErrorCodes.SUCCESS:
        raise PlannerError(error_text(result.error_code))
    points = result.planned_trajectory.joint_trajectory.points
    last = points[-1].time_from_start if points else None
    duration_s = last.sec + last.nanosec * 1e-9 if last else 0.0
    return PlannedMotion(float(result.planning_time), duration_s, len(points))
