"""The services of move_group: planning, kinematics, state checks, the planning scene and the list of planners."""

from collections.abc import Awaitable, Callable
from functools import partial
from typing import Any, Final

from moveit_msgs.msg import ConstraintEvalResult, PlannerInterfaceDescription, PlannerParams
from moveit_msgs.srv import (
    ApplyPlanningScene,
    GetCartesianPath,
    GetGroupUrdf,
    GetMotionPlan,
    GetPlannerParams,
    GetPlanningScene,
    GetPositionFK,
    GetPositionIK,
    GetStateValidity,
    QueryPlannerInterfaces,
    SetPlannerParams,
)
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from std_srvs.srv import Empty

from drivers.printable import printable_line
from nodes.planning.controllers import StopRequest
from nodes.planning.conversion.trajectories import trajectory_message
from nodes.planning.joint_monitor import JointMonitor
from nodes.planning.move_action import Planning
from nodes.planning.request_errors import REFUSALS, RequestError, crash, error_code, success
from nodes.planning.requests import PIPELINE, Snapshot
from nodes.planning.scene_messages import scene_message
from nodes.planning.states import state_message
from nodes.planning.workers import Workers
from nodes.planning.world_store import WorldStore
from nodes.publishing import EVERY_CALL
from planning.motion import State

PLANNERS: Final = (
    "RRTConnectkConfigDefault",
    "RRTstarkConfigDefault",
    "PRMkConfigDefault",
    "BKPIECEkConfigDefault",
    "KPIECEkConfigDefault",
    "ESTkConfigDefault",
    "LBKPIECEkConfigDefault",
)
"""Planner IDs for MoveIt."""


class QueryServices:
    """Server of requests that do not move the robot. Long computations run in other threads."""

    def __init__(
        self, node: Node, planning: Planning, store: WorldStore, joints: JointMonitor, workers: Workers
    ) -> None:
        self._requests = planning.requests
        self._robot = planning.requests.robot
        self._planning = planning
        self._store = store
        self._joints = joints
        self._workers = workers
        self._node, self._log = node, node.get_logger()
        # The server responds to a request while others are still being computed.
        self._group = ReentrantCallbackGroup()
        services: tuple[tuple[Any, str, Callable[..., Any]], ...] = (
            (GetMotionPlan, "plan_kinematic_path", self._plan),
            (GetPositionIK, "compute_ik", self._inverse),
            (GetPositionFK, "compute_fk", self._forward),
            (GetCartesianPath, "compute_cartesian_path", self._straight),
            (GetStateValidity, "check_state_validity", self._validity),
            (GetPlanningScene, "get_planning_scene", self._scene),
            (ApplyPlanningScene, "apply_planning_scene", self._apply),
            (QueryPlannerInterfaces, "query_planner_interface", self._planners),
            (GetPlannerParams, "get_planner_params", self._parameters),
            (SetPlannerParams, "set_planner_params", self._set_parameters),
            (Empty, "clear_octomap", lambda _, response: response),
            (GetGroupUrdf, "get_urdf", self._urdf),
        )
        for kind, name, answer in services:
            node.create_service(kind, name, answer, qos_profile=EVERY_CALL, callback_group=self._group)

    async def _plan(self, request: Any, response: Any) -> Any:
        answer = response.motion_plan_response
        answer.group_name = request.motion_plan_request.group_name

        async def plan() -> None:
            planned = await self._planning.plan(request.motion_plan_request, StopRequest())
            answer.trajectory_start = state_message(self._robot, planned.start)
            answer.trajectory = trajectory_message(planned.motion, self._robot.frame)
            answer.planning_time = planned.seconds

        await self._answer(answer, "plan_kinematic_path", plan())
        return response

    async def _inverse(self, request: Any, response: Any) -> Any:
        async def compute() -> None:
            now = await self._store.snapshot()
            found = await self._workers.compute(partial(self._requests.inverse, request.ik_request, now))
            response.solution = state_message(self._robot, found)

        await self._answer(response, "compute_ik", compute())
        return response

    async def _forward(self, request: Any, response: Any) -> Any:
        async def compute() -> None:
            now = await self._now(request.robot_state.joint_state.name)
            response.pose_stamped = await self._workers.compute(partial(self._requests.forward, request, now))
            response.fk_link_names = list(request.fk_link_names)

        await self._answer(response, "compute_fk", compute())
        return response

    async def _straight(self, request: Any, response: Any) -> Any:
        async def compute() -> None:
            now = await self._now(request.start_state.joint_state.name)
            start, found = await self._workers.compute(partial(self._requests.straight, request, now))
            response.start_state, response.fraction = state_message(self._robot, start), found.fraction
            if found.motion is not None:
                response.solution = trajectory_message(found.motion, self._robot.frame)
                self._planning.show(found.motion, start, now.world)
            reasons.append(found.reason)

        reasons: list[str] = []
        await self._answer(response, "compute_cartesian_path", compute())
        if reasons:
            response.error_code.message = printable_line(reasons[0])
        return response

    async def _validity(self, request: Any, response: Any) -> Any:
        try:
            now = await self._now(request.robot_state.joint_state.name)
            found, results, world = await self._workers.compute(partial(self._requests.validity, request, now))
        except REFUSALS as error:
            self._refused("check_state_validity", error)
            return response
        except Exception as error:  # After an error, the server must remain available to the other clients.
            crash(self._log, error)
            return response
        response.valid = found.is_valid and not any(one.text for one in results)
        response.contacts = self._requests.contacts(found, world)
        response.constraint_result = [
            ConstraintEvalResult(result=not one.text, distance=one.distance) for one in results
        ]
        return response

    def _scene(self, request: Any, response: Any) -> Any:
        try:
            state: State | None = self._joints.state()
        except RequestError:
            state = None
        response.scene = scene_message(self._robot, self._store.world, state, int(request.components.components))
        return response

    def _apply(self, request: Any, response: Any) -> Any:
        response.success = not self._store.apply_scene(request.scene)
        return response

    def _planners(self, _: Any, response: Any) -> Any:
        response.planner_interfaces = [
            PlannerInterfaceDescription(name="OMPL", pipeline_id=PIPELINE, planner_ids=list(PLANNERS))
        ]
        return response

    def _parameters(self, _: Any, response: Any) -> Any:
        response.params = PlannerParams()
        return response

    def _set_parameters(self, request: Any, response: Any) -> Any:
        if request.params.keys:
            names = ", ".join(request.params.keys)
            self._log.warning(printable_line(f"planner parameters have no effect in this server: {names}"))
        return response

    def _urdf(self, request: Any, response: Any) -> Any:
        try:
            self._robot.group(request.group_name)
            response.urdf_string, response.error_code = self._robot.description.xml, success()
        except REFUSALS as error:
            response.error_code = self._refused("get_urdf", error)
        return response

    async def _now(self, names: list[str]) -> Snapshot:
        """Return the scene and the state. A request that contains all joints does not require a measured state."""
        if set(self._robot.limits) <= set(names):
            return Snapshot(self._store.world, self._robot.rest)
        return await self._store.snapshot()

    async def _answer(self, response: Any, name: str, work: Awaitable[None]) -> None:
        """Execute the request, and set the error code of the response."""
        try:
            await work
            response.error_code = success()
        except REFUSALS as error:
            response.error_code = self._refused(name, error)
        except Exception as error:  # After an error, the server must remain available to the other clients.
            response.error_code = crash(self._log, error)

    def _refused(self, name: str, error: Any) -> Any:
        self._log.warning(printable_line(f"{self._node.resolve_service_name(name)}: {error.code}: {error}"))
        return error_code(error)
