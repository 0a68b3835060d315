"""Serve the move_group actions: plan and execute a motion, and execute a trajectory."""

from collections.abc import Awaitable, Callable
from dataclasses import replace
from functools import partial
from time import monotonic
from typing import Any, Final

from moveit_msgs.action import ExecuteTrajectory, MoveGroup
from moveit_msgs.msg import DisplayTrajectory, MotionPlanRequest, PlanningScene, RobotState
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node

from drivers.printable import printable_line
from nodes.controllers.action_goals import RESULT_TIMEOUT_S
from nodes.pick_place.waiter import Waiter
from nodes.planning.controllers import StopRequest
from nodes.planning.conversion.semantic import robot_name
from nodes.planning.conversion.trajectories import trajectory_message
from nodes.planning.edits import WorldEdit
from nodes.planning.execution import INVALIDATED, Execution
from nodes.planning.request_errors import REFUSALS, RequestError, crash, error_code, success
from nodes.planning.requests import Planned, Requests, Snapshot
from nodes.planning.states import state_message
from nodes.planning.workers import Workers
from nodes.planning.world import PlanningWorld
from nodes.planning.world_store import WorldStore
from nodes.publishing import EVERY_CALL, LATCHED
from planning.motion import Motion, State

REPLANS: Final = 5
"""Default number of replanning attempts after scene changes."""
MOST_REPLANS: Final = 100
"""Maximum number of replanning attempts."""
LONGEST_DELAY_S: Final = 10.0
"""Maximum delay before replanning, in seconds."""
CANCELED: Final = "the goal was canceled"
"""Message of a goal that was canceled."""

Run = Callable[[Any, Any, StopRequest], Awaitable[None]]
"""Function that executes the goal of a handle and fills in its result."""


class Planning:
    """Planner that uses the search thread and publishes its plans for display. All methods must be called from the
    executor thread."""

    def __init__(self, node: Node, requests: Requests, store: WorldStore, workers: Workers) -> None:
        self.requests = requests
        """Object that computes the responses."""
        self._store = store
        self._workers = workers
        self._plans = node.create_publisher(DisplayTrajectory, "display_planned_path", LATCHED)

    async def plan(self, request: MotionPlanRequest, stop: StopRequest, diff: PlanningScene | None = None) -> Planned:
        """Plan a motion and publish it for display. Raises RequestError or PlanningError."""
        robot = self.requests.robot
        limit_s = self.requests.time_limit_s(request)
        now = await self._store.snapshot()
        if diff is not None and _has_changes(diff):
            edit = WorldEdit(robot, now.world, lambda: now.state)
            edit.apply_scene(diff)
            now = replace(now, world=edit.world)
        planned = await self._workers.search(partial(self._plan, request, now, limit_s, stop))
        stop.check()
        self.show(planned.motion, planned.start, now.world)
        return planned

    def show(self, motion: Motion, start: State, world: PlanningWorld) -> None:
        """Publish a motion for display."""
        robot = self.requests.robot
        self._plans.publish(
            DisplayTrajectory(
                model_id=robot_name(robot),
                trajectory=[trajectory_message(motion, robot.frame)],
                trajectory_start=state_message(robot, start, world),
            )
        )

    def _plan(self, request: MotionPlanRequest, now: Snapshot, limit_s: float, stop: StopRequest) -> Planned:
        end_s = monotonic() + limit_s
        stop.check()
        return self.requests.motion(request, now, lambda: 0.0 if stop.requested else end_s - monotonic())


class MoveActions:
    """Server of /move_action and /execute_trajectory. Several goals may run at the same time, but each plan waits for
    earlier plans to finish."""

    def __init__(self, node: Node, planning: Planning, execution: Execution) -> None:
        self._planning = planning
        self._execution = execution
        self._robot = planning.requests.robot
        self._log = node.get_logger()
        self._waiter = Waiter(node)
        self._stops: dict[bytes, StopRequest] = {}
        self._is_closed = False
        self._servers = [
            self._server(node, MoveGroup, "move_action", self._move),
            self._server(node, ExecuteTrajectory, "execute_trajectory", self._execute),
        ]

    def close(self, code: str, message: str) -> None:
        """Stop all goals, and reject all further goals."""
        self._is_closed = True
        self.stop_all(code, message)

    def stop_all(self, code: str, message: str) -> None:
        """Stop all goals, including those that are still being planned."""
        for stop in self._stops.values():
            stop.request(code, message)
        self._execution.stop_all(code, message)

    @property
    def is_idle(self) -> bool:
        """Whether no goal is running."""
        return not self._stops

    def _server(self, node: Node, kind: Any, name: str, run: Run) -> ActionServer:
        async def execute(handle: Any) -> Any:
            return await self._answer(kind, run, handle)

        return ActionServer(
            node,
            kind,
            name,
            execute,
            goal_callback=partial(self._on_goal, name),
            handle_accepted_callback=self._on_accepted,
            cancel_callback=self._on_cancel,
            callback_group=ReentrantCallbackGroup(),
            goal_service_qos_profile=EVERY_CALL,
            cancel_service_qos_profile=EVERY_CALL,
            result_service_qos_profile=EVERY_CALL,
            result_timeout=RESULT_TIMEOUT_S,
        )

    def _on_goal(self, name: str, _: Any) -> GoalResponse:
        if not self._is_closed:
            return GoalResponse.ACCEPT
        self._log.warning(f"a goal of {name} was rejected, because the planning server is shutting down")
        return GoalResponse.REJECT

    def _on_accepted(self, handle: Any) -> None:
        """Register the goal. The server calls ``execute`` only in the next iteration of the executor, but a request to
        stop may arrive earlier."""
        self._stops[bytes(handle.goal_id.uuid)] = StopRequest()
        handle.execute()

    def _on_cancel(self, handle: Any) -> CancelResponse:
        self._stops[bytes(handle.goal_id.uuid)].request("PREEMPTED", CANCELED)
        return CancelResponse.ACCEPT

    async def _answer(self, kind: Any, run: Run, handle: Any) -> Any:
        """Run one goal and return its result."""
        result, stop = kind.Result(), self._stops[bytes(handle.goal_id.uuid)]
        try:
            await run(handle, result, stop)
            result.error_code = success()
        except REFUSALS as error:
            known = RequestError(stop.code, stop.message) if stop.requested else error
            result.error_code = error_code(known)
            self._log.warning(printable_line(f"{known.code}: {known}"))
        except Exception as error:  # After an error, the server must remain available to the other clients.
            result.error_code = crash(self._log, error)
        finally:
            del self._stops[bytes(handle.goal_id.uuid)]
        if result.error_code.val == result.error_code.SUCCESS:
            handle.succeed()
        elif handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
        return result

    async def _execute(self, handle: Any, result: Any, stop: StopRequest) -> None:
        goal = handle.request
        handle.publish_feedback(ExecuteTrajectory.Feedback(state="MONITOR"))
        await self._execution.run(goal.trajectory, goal.controller_names, stop)
        handle.publish_feedback(ExecuteTrajectory.Feedback(state="IDLE"))

    async def _move(self, handle: Any, result: Any, stop: StopRequest) -> None:
        request, options = handle.request.request, handle.request.planning_options
        if options.look_around:
            self._log.warning("look_around is ignored: this server has no sensors")
        if not options.plan_only and request.start_state.joint_state.name:
            request.start_state = RobotState(
                is_diff=True, attached_collision_objects=request.start_state.attached_collision_objects
            )  # A motion begins at the current state of the robot, as in MoveIt.
        for replans in range(_replans(options) + 1):
            handle.publish_feedback(MoveGroup.Feedback(state="PLANNING"))
            planned = await self._planning.plan(request, stop, options.planning_scene_diff)
            result.planned_trajectory = trajectory_message(planned.motion, self._robot.frame)
            result.trajectory_start = state_message(self._robot, planned.start)
            result.planning_time = planned.seconds
            if options.plan_only:
                return
            handle.publish_feedback(MoveGroup.Feedback(state="MONITOR"))
            try:
                await self._run(result, stop)
                return
            except RequestError as error:
                if error.code != INVALIDATED or stop.requested or replans == _replans(options):
                    raise
                self._log.info(printable_line(f"planning again: {error}"))
            await self._waiter.until(min(max(options.replan_delay, 0.0), LONGEST_DELAY_S) + 1e-3, stop.future)

    async def _run(self, result: Any, stop: StopRequest) -> None:
        """Execute the planned trajectory. A scene change stops only the current attempt."""
        attempt = StopRequest()
        stop.future.add_done_callback(lambda _: attempt.request(stop.code, stop.message))
        if stop.requested:
            attempt.request(stop.code, stop.message)
        await self._execution.run(result.planned_trajectory, (), attempt, must_be_free=True)


def _replans(options: Any) -> int:
    if not options.replan:
        return 0
    return min(options.replan_attempts, MOST_REPLANS) if options.replan_attempts > 0 else REPLANS


def _has_changes(diff: PlanningScene) -> bool:
    """Return whether a scene message contains changes. Clients that do not change the scene send the default message,
    which has an empty scene."""
    return bool(
        diff.is_diff
        or diff.robot_model_name
        or diff.world.collision_objects
        or diff.robot_state.attached_collision_objects
        or diff.allowed_collision_matrix.entry_names
    )
