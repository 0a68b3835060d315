"""Client of a move_group node. A separate thread spins the client, so that every call can wait."""

import atexit
import os
import threading
import time
from contextlib import suppress
from typing import Any, Final

import rclpy
from moveit_msgs.action import ExecuteTrajectory
from moveit_msgs.msg import MoveItErrorCodes, PlanningSceneComponents, RobotState, RobotTrajectory
from moveit_msgs.srv import GetMotionPlan, GetPlanningScene, GetPositionFK, GetPositionIK
from rcl_interfaces.srv import GetParameters
from rclpy.action import ActionClient
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.task import Future

from nodes.discovery import stay_on_this_machine

SERVER_S: Final = 10.0
"""Maximum time for a server to appear, in seconds."""
RESPONSE_S: Final = 5.0
"""Maximum time for a response, in addition to the time that the request itself allows, in seconds."""
EXECUTION_MARGIN_S: Final = 15.0
"""Maximum time for an execution, in addition to twice the duration of the trajectory, in seconds."""
GONE_S: Final = 2.0
"""Minimum time the server must be missing before the client stops waiting for its result, in seconds."""
POLL_S: Final = 0.05
EXECUTE_ACTION: Final = "execute_trajectory"


class PlanningClient:
    """Client of a move_group node in a separate context, so that it is independent of the program's ``rclpy.init``."""

    def __init__(self, node_name: str) -> None:
        stay_on_this_machine(os.environ)
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self.node: Any = rclpy.create_node(node_name, context=self._context)
        self._clients: dict[str, Any] = {}
        self._canceled: Future | None = None
        self._executions = ActionClient(self.node, ExecuteTrajectory, EXECUTE_ACTION)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._spin, name=node_name, daemon=True)
        self._thread.start()
        atexit.register(self.shutdown)

    def _spin(self) -> None:
        with suppress(ExternalShutdownException):
            self._executor.spin()

    def shutdown(self) -> None:
        """Leave the ROS graph, after the last cancel request was sent. A second call has no effect."""
        if self._context.ok():
            if self._canceled is not None:
                _wait(self._canceled, RESPONSE_S)
            self._executor.shutdown(timeout_sec=1.0)
            self._thread.join(1.0)
            self.node.destroy_node()
            self._context.try_shutdown()

    def descriptions(self) -> tuple[str, str]:
        """Return the URDF and the SRDF of the robot. Raises RuntimeError if no node provides them."""
        request = GetParameters.Request(names=["robot_description", "robot_description_semantic"])
        values = self.call(GetParameters, "move_group/get_parameters", request).values
        texts = [value.string_value for value in values]
        if len(texts) != 2 or not all(texts):
            raise RuntimeError("move_group has no parameters robot_description and robot_description_semantic")
        return texts[0], texts[1]

    def current_state(self) -> RobotState:
        """Return the current state of the robot. Raises RuntimeError."""
        components = PlanningSceneComponents(components=PlanningSceneComponents.ROBOT_STATE)
        request = GetPlanningScene.Request(components=components)
        return self.call(GetPlanningScene, "get_planning_scene", request).scene.robot_state

    def plan(self, request: Any) -> Any:
        """Return the response (moveit_msgs/MotionPlanResponse) to a MotionPlanRequest. Raises RuntimeError."""
        call = GetMotionPlan.Request(motion_plan_request=request)
        response = self.call(GetMotionPlan, "plan_kinematic_path", call, request.allowed_planning_time)
        return response.motion_plan_response

    def forward(self, state: RobotState, links: list[str], frame: str) -> Any:
        """Return the response (moveit_msgs/srv/GetPositionFK) with the poses of links. Raises RuntimeError."""
        request = GetPositionFK.Request(fk_link_names=links, robot_state=state)
        request.header.frame_id = frame
        return self.call(GetPositionFK, "compute_fk", request)

    def inverse(self, request: Any, timeout_s: float) -> Any:
        """Return the response (moveit_msgs/srv/GetPositionIK) to a PositionIKRequest. Raises RuntimeError."""
        return self.call(GetPositionIK, "compute_ik", GetPositionIK.Request(ik_request=request), timeout_s)

    def call(self, service: Any, name: str, request: Any, more_s: float = 0.0) -> Any:
        """Call a service and return its response.

        Args:
            service: Type of the service.
            name: Name of the service.
            request: Request.
            more_s: Time that the request itself allows, in seconds.

        Raises:
            RuntimeError: No node provides the service, or it did not respond in time.
        """
        name = self.node.resolve_service_name(name)
        client = self._clients.get(name) or self._clients.setdefault(name, self.node.create_client(service, name))
        self._wait_for(client.service_is_ready, name)
        future = client.call_async(request)
        if not _wait(future, RESPONSE_S + more_s):
            client.remove_pending_request(future)
            raise RuntimeError(
                f"{name} did not respond within {RESPONSE_S + more_s:.0f} s: check the log of move_group"
            )
        return future.result()

    def _wait_for(self, is_ready: Any, name: str) -> None:
        end_s = time.monotonic() + SERVER_S
        while not is_ready():
            if time.monotonic() > end_s:
                raise RuntimeError(
                    f"no node provides {name}: start `servoloop up --plan`, or `servoloop plan-server` next to a stack"
                )
            time.sleep(POLL_S)

    def execute(self, trajectory: RobotTrajectory, duration_s: float, controllers: list[str]) -> MoveItErrorCodes:
        """Execute a trajectory, wait for its end, and return its result. An exception cancels the execution.

        Raises:
            RuntimeError: No node executes trajectories, or no result arrives in time.
        """
        action = self.node.resolve_service_name(EXECUTE_ACTION)
        self._wait_for(self._executions.server_is_ready, action)
        goal = ExecuteTrajectory.Goal(trajectory=trajectory, controller_names=controllers)
        sent = self._executions.send_goal_async(goal)
        try:
            if not _wait(sent, RESPONSE_S):
                raise RuntimeError(f"{action} did not respond within {RESPONSE_S:.0f} s")
            handle = sent.result()
            if not handle.accepted:
                message = "move_group rejected the trajectory; its log contains the reason"
                return MoveItErrorCodes(val=MoveItErrorCodes.FAILURE, message=message)
            result = handle.get_result_async()
            self._wait_for_result(result, 2.0 * duration_s + EXECUTION_MARGIN_S)
        except BaseException:
            sent.add_done_callback(_cancel)
            self._canceled = sent
            raise
        return result.result().result.error_code

    def _wait_for_result(self, result: Future, timeout_s: float) -> None:
        end_s = seen_s = time.monotonic()
        end_s += timeout_s
        while not result.done():
            time.sleep(POLL_S)
            now_s = time.monotonic()
            seen_s = now_s if self._executions.server_is_ready() else seen_s
            if now_s > end_s:
                raise RuntimeError(f"the execution did not finish within {timeout_s:.0f} s and is canceled")
            if now_s - seen_s > GONE_S:
                raise RuntimeError("move_group disappeared during the execution: check its log")


def _wait(future: Future, timeout_s: float) -> bool:
    """Wait for a future of another thread, and return whether it is done."""
    done = threading.Event()
    future.add_done_callback(lambda _: done.set())
    return done.wait(timeout_s)


def _cancel(sent: Future) -> None:
    if sent.result() is not None and sent.result().accepted:
        sent.result().cancel_goal_async()
