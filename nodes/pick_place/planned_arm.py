"""Plan and execute the motions of a job through the MoveIt interfaces of the move_group node."""

from collections.abc import Sequence
from typing import Any, Final

from moveit_msgs.action import ExecuteTrajectory, MoveGroup
from moveit_msgs.msg import PlanningScene
from moveit_msgs.srv import ApplyPlanningScene, GetCartesianPath, GetPlanningScene
from rclpy.node import Node
from rclpy.task import Future
from std_msgs.msg import Float64MultiArray

from nodes.pick_place import planning_messages as messages
from nodes.pick_place.action_goals import SentGoals
from nodes.pick_place.arm import hand_topic
from nodes.pick_place.waiter import Waiter
from nodes.planning_client.goals import error_text
from nodes.planning_client.scenes import OBJECTS, removal
from pick_place.job import JobOutcome
from pick_place.pose_settings import PoseSettings, ToolPose

MOVE_ACTION: Final = "move_action"
EXECUTE_ACTION: Final = "execute_trajectory"
COMPLETE: Final = 1.0 - 1e-6
"""Minimum fraction of a straight line that must be planned for the line to be considered complete."""


class PlannedArm:
    """Arm and hand that are moved through a motion planner, one motion at a time. All methods must be called from the
    executor thread."""

    def __init__(self, node: Node, settings: PoseSettings) -> None:
        self._settings = settings
        self._waiter = Waiter(node)
        self._plans = SentGoals(node, settings, (MoveGroup, MOVE_ACTION), _reason)
        self._executions = SentGoals(node, settings, (ExecuteTrajectory, EXECUTE_ACTION), _reason)
        self._lines = node.create_client(GetCartesianPath, "compute_cartesian_path")
        self._scene = node.create_client(GetPlanningScene, "get_planning_scene")
        self._changes = node.create_client(ApplyPlanningScene, "apply_planning_scene")
        self._hand = node.create_publisher(Float64MultiArray, hand_topic(settings), 10)
        self._stop = Future()

    def wait_for_server(self, timeout_s: float) -> bool:
        """Block until the planner's action server appears, and return whether it appeared in time."""
        return self._plans.wait_for_server(timeout_s)

    def stop(self) -> None:
        """Cancel the running motion, if any, and stop waiting for it."""
        self._plans.stop()
        self._executions.stop()
        if not self._stop.done():
            self._stop.set_result(None)

    async def move(self, positions_rad: Sequence[float]) -> JobOutcome:
        """Plan a motion to the given joint positions and execute it."""
        return await self._plan(messages.joint_goal(self._settings, positions_rad))

    async def move_to(self, pose: ToolPose) -> JobOutcome:
        """Plan a motion that moves the tool to a pose, and execute it."""
        return await self._plan(messages.pose_goal(self._settings, pose))

    async def _plan(self, goal: Any) -> JobOutcome:
        return await self._plans.send(goal, self._settings.planning_time_s)

    async def move_straight(self, pose: ToolPose) -> JobOutcome:
        """Move the tool to a pose in a straight line."""
        outcome, line = await self._call(self._lines, messages.line(self._settings, pose))
        if not outcome.reached:
            return outcome
        if line.fraction < COMPLETE:
            reason = error_text(line.error_code)
            return JobOutcome(False, f"the straight line ends after {line.fraction:.0%} of its length: {reason}")
        return await self._executions.send(ExecuteTrajectory.Goal(trajectory=line.solution))

    async def hand(self, position_m: float) -> JobOutcome:
        """Send a finger position, and wait until the fingers have had time to reach it."""
        self._hand.publish(Float64MultiArray(data=[position_m]))
        self._stop = Future()
        await self._waiter.until_moved(self._settings.hand_time_s, lambda: True, self._stop)
        return JobOutcome(not self._stop.done())

    async def lay_object(self) -> JobOutcome:
        """Add the object to the planning scene at its position before picking."""
        return await self._change(messages.laid(self._settings))

    async def attach_object(self) -> JobOutcome:
        """Attach the object to the tool at its position before picking, where the tool grips it in the pick pose."""
        return await self._change(messages.attached(self._settings))

    async def remove_object(self) -> JobOutcome:
        """Remove the object from the tool and from the planning scene. The object does not have to exist."""
        return await self._remove(only_attached=False)

    async def drop_object(self) -> JobOutcome:
        """Remove the object if it is attached to the tool. If the object is not attached, leave the scene unchanged."""
        return await self._remove(only_attached=True)

    async def _remove(self, *, only_attached: bool) -> JobOutcome:
        """Remove the object from its current position. MoveIt reports a failure if the object to remove does not
        exist."""
        outcome, response = await self._call(self._scene, OBJECTS)
        if not outcome.reached:
            return outcome
        name, scene = self._settings.target.name, response.scene
        attached = name in {held.object.id for held in scene.robot_state.attached_collision_objects}
        # MoveIt moves a detached object into the world, so the object must also be removed from the world.
        laid = name in {item.id for item in scene.world.collision_objects} and not only_attached
        if not (attached or laid):
            return JobOutcome(True)
        return await self._change(removal(name, is_attached=attached))

    async def _change(self, scene: PlanningScene) -> JobOutcome:
        outcome, response = await self._call(self._changes, ApplyPlanningScene.Request(scene=scene))
        if outcome.reached and not response.success:
            return JobOutcome(False, "the planning scene was not changed; the log of move_group contains the reason")
        return outcome

    async def _call(self, client: Any, request: Any) -> tuple[JobOutcome, Any]:
        """Call a service, and return whether it responded in time and before a stop, together with the response."""
        waits_s = self._settings.goal_timeout_s + self._settings.planning_time_s
        self._stop = Future()
        server_s = self._settings.server_timeout_s
        found = await self._waiter.until_ready(server_s, client.service_is_ready, self._stop)
        if self._stop.done():
            return JobOutcome(False), None
        if not found:
            text = f"the service {client.service_name} is not available (waited {server_s:g} s)"
            return JobOutcome(False, text), None
        answer = client.call_async(request)
        await self._waiter.until(waits_s, answer, self._stop)
        if answer.done() and not self._stop.done():
            return JobOutcome(True), answer.result()
        client.remove_pending_request(answer)
        text = "" if self._stop.done() else f"{client.service_name} did not respond (waited {waits_s:g} s)"
        return JobOutcome(False, text), None


def _reason(result: Any) -> str:
    return error_text(result.error_code)
