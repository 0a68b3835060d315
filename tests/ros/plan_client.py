"""A client of move_group, and a stack with a planning server for it."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import rclpy
from action_msgs.srv import CancelGoal
from geometry_msgs.msg import Point, Pose
from moveit_msgs.action import ExecuteTrajectory, MoveGroup
from moveit_msgs.msg import CollisionObject, Constraints, JointConstraint, PlanningScene
from moveit_msgs.srv import ApplyPlanningScene
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from shape_msgs.msg import SolidPrimitive
from std_msgs.msg import Header

from nodes.ros_process import spin_until_done
from tests.ros.stack_process import PATIENCE_S, StackProcess, running, until

READY = dict(zip([f"joint{i}" for i in range(1, 7)], (0.0, -0.3643, -0.6419, -0.8154, -0.9541, -1.6828), strict=True))


class PlanClient:
    """Sends requests and waits for their answers."""

    def __init__(self) -> None:
        rclpy.init()
        self.node = rclpy.create_node("plan_client")
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self._actions: dict[str, ActionClient] = {}
        self._services: dict[str, Any] = {}

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown()

    def wait(self, future: Any) -> Any:
        assert spin_until_done(self.executor, future, PATIENCE_S), "no answer"
        return future.result()

    def spin(self, seconds: float) -> None:
        end_ns = self.node.get_clock().now().nanoseconds + seconds * 1e9
        while self.node.get_clock().now().nanoseconds < end_ns:
            self.executor.spin_once(timeout_sec=0.02)

    def call(self, kind: Any, name: str, request: Any) -> Any:
        return self.wait(self.begin(kind, name, request))

    def begin(self, kind: Any, name: str, request: Any) -> Any:
        if name not in self._services:
            self._services[name] = self.node.create_client(kind, name)
        assert self._services[name].wait_for_service(PATIENCE_S), name
        return self._services[name].call_async(request)

    def send(self, goal: Any) -> Any:
        """Send a goal of /move_action or /execute_trajectory and return its handle."""
        kind = MoveGroup if isinstance(goal, MoveGroup.Goal) else ExecuteTrajectory
        name = "/move_action" if kind is MoveGroup else "/execute_trajectory"
        if name not in self._actions:
            self._actions[name] = ActionClient(self.node, kind, name)
        assert self._actions[name].wait_for_server(PATIENCE_S), name
        handle = self.wait(self._actions[name].send_goal_async(goal))
        assert handle.accepted
        return handle

    def result(self, handle: Any) -> Any:
        return self.wait(handle.get_result_async()).result

    def run(self, goal: Any) -> Any:
        """Send a goal and return its result."""
        return self.result(self.send(goal))

    def cancel(self, handle: Any) -> bool:
        return self.wait(handle.cancel_goal_async()).return_code == CancelGoal.Response.ERROR_NONE

    def apply(self, *objects: CollisionObject) -> bool:
        scene = PlanningScene(is_diff=True)
        scene.robot_state.is_diff = True
        scene.world.collision_objects = list(objects)
        request = ApplyPlanningScene.Request(scene=scene)
        return self.call(ApplyPlanningScene, "/apply_planning_scene", request).success


def joint_goal(group: str = "arm", plan_only: bool = False, **positions: float) -> MoveGroup.Goal:
    goal = MoveGroup.Goal()
    goal.request.group_name, goal.request.allowed_planning_time = group, 3.0
    goal.request.goal_constraints = [joint_constraints(**positions)]
    goal.planning_options.plan_only = plan_only
    goal.planning_options.planning_scene_diff.is_diff = True
    return goal


def joint_constraints(**positions: float) -> Constraints:
    return Constraints(
        joint_constraints=[
            JointConstraint(joint_name=name, position=at, tolerance_above=1e-3, tolerance_below=1e-3, weight=1.0)
            for name, at in positions.items()
        ]
    )


def box(name: str, place_m: tuple[float, float, float], sides_m: tuple[float, float, float]) -> CollisionObject:
    x, y, z = place_m
    item = CollisionObject(header=Header(frame_id="base_link"), id=name, pose=Pose(position=Point(x=x, y=y, z=z)))
    item.primitives = [SolidPrimitive(type=SolidPrimitive.BOX, dimensions=list(sides_m))]
    item.primitive_poses = [Pose()]
    return item


def remove(name: str) -> CollisionObject:
    return CollisionObject(id=name, operation=CollisionObject.REMOVE)


@contextmanager
def planning_stack(folder: Path, *arguments: str) -> Iterator[PlanClient]:
    """Run a stack without servos and a planning server with the same arguments, and yield a client."""
    with running(folder, "--hardware", "mock", *arguments):
        server = StackProcess(folder / "plan.log", "plan-server", *arguments)
        try:
            until(lambda: "ready:" in server.words, lambda: server.process.poll() is not None and server.words)
            client = PlanClient()
            try:
                yield client
            finally:
                client.close()
        finally:
            assert server.end() == 0, server.words
