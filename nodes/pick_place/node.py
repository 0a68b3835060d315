"""Serve the action, topics and service of the pick-and-place application. The steps of a job are in job.py.

Everything runs in the thread of a SingleThreadedExecutor. Callbacks never overlap, so neither the job nor the flags
need a lock. A job is a task of this executor: it awaits results and never blocks.
"""

from collections.abc import Callable
from typing import Any

from apple_quality_msgs.msg import AppleQualityArray
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.node import Node
from rclpy.task import Future
from sorting_arm_interfaces.action import PickPlace
from std_msgs.msg import String
from std_srvs.srv import SetBool

from drivers.printable import printable_line
from nodes.controllers.action_goals import RESULT_TIMEOUT_S
from nodes.pick_place import parameters
from nodes.pick_place.motions import motions_of
from nodes.pick_place.waiter import Waiter
from pick_place.job import JobEnding, PickPlaceJob, Result, State
from pick_place.settings import normal_grade
from pick_place.state import state_json
from pick_place.vision import candidate, reason_not_fresh

_LOG_EVERY_S = 5.0
_RESULT_DELAY_S = 0.1
_DISCOVERY_S = 4.0
"""Time to discover the arm before the first job, in seconds. DDS participants find each other at their next
announcement, which Fast DDS sends every 3 s without this_machine.xml. A job itself waits only 2 s for the arm."""


class PickPlaceNode:
    """ROS interface of the node. ``PickPlaceJob`` implements the job itself."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._log = node.get_logger()
        self._settings = parameters.declare(node)
        self._motions = motions_of(node, self._settings)
        self._grades = self._motions.of_job().grades
        self._waiter = Waiter(node)
        self._enabled = True
        self._stopping = False
        self._job: PickPlaceJob | None = None
        self._idle = Future()
        self._seq = 0
        self._jobs = 0
        self._states = node.create_publisher(String, "sorting/arm/state", 10)
        node.create_subscription(AppleQualityArray, "sorting/perception/apple_quality", self._on_vision, 10)
        node.create_service(SetBool, "sorting/arm/enable", self._on_enable)
        if not self._motions.arm.wait_for_server(_DISCOVERY_S):
            self._log.warning(f"{self._motions.missing}; otherwise, jobs will fail after a short wait")
        self._server = self._serve(parameters.action_name(node))
        self._log.info(printable_line(f"ready for goals; grades {', '.join(self._grades)}"))

    async def stop(self) -> None:
        """Reject new jobs, cancel the running job and send its result."""
        self._stopping = True
        if self._job is not None:
            self._log.info("stopping: canceling the running job")
            self._idle = Future()
            self._job.cancel("canceled: the node is stopping")
            self._waiter.wake()
            await self._waiter.until(self._longest_cancel_s(), self._idle)
            await self._waiter.until(_RESULT_DELAY_S)

    def _longest_cancel_s(self) -> float:
        return self._settings.goal_timeout_s + self._settings.cancel_timeout_s + 1.0

    def _serve(self, name: str) -> ActionServer:
        return ActionServer(
            self._node,
            PickPlace,
            name,
            self._execute,
            goal_callback=self._on_goal,
            handle_accepted_callback=self._on_accepted,
            cancel_callback=self._on_cancel,
            result_timeout=RESULT_TIMEOUT_S,
        )

    def _on_goal(self, goal: Any) -> GoalResponse:
        reason = self._reason_to_reject(goal.grade)
        if reason is None:
            return GoalResponse.ACCEPT
        self._log.warning(printable_line(f"goal rejected: {reason}"))
        return GoalResponse.REJECT

    def _on_accepted(self, handle: Any) -> None:
        # If _on_goal created the job and the response to the client were lost, the node would remain busy.
        self._job = self._new_job(handle.request.grade, handle.publish_feedback)
        handle.execute()

    def _on_cancel(self, _handle: Any) -> CancelResponse:
        if self._job is not None:
            self._job.cancel()
            self._waiter.wake()
        return CancelResponse.ACCEPT

    def _on_enable(self, request: Any, response: Any) -> Any:
        self._enabled = request.data
        response.success = True
        response.message = "enabled" if self._enabled else "disabled: no new job starts"
        self._log.info(response.message)
        return response

    def _on_vision(self, message: Any) -> None:
        if not self._node.get_parameter(parameters.AUTO_GOAL).value:
            return
        grade = candidate(apple.grade for apple in message.apples)
        reason = self._reason_to_ignore(message.header.stamp, grade)
        if reason is not None:
            # A camera sends the same message many times per second.
            self._log.warning(printable_line(f"vision message ignored: {reason}"), throttle_duration_sec=_LOG_EVERY_S)
            return
        self._job = self._new_job(grade or "", None)
        self._node.executor.create_task(self._run, self._job)

    def _reason_to_reject(self, grade: str) -> str | None:
        if self._stopping:
            return "the node is stopping"
        if not normal_grade(grade):
            return f"the grade is empty; known grades: {', '.join(self._grades)}"
        if not self._enabled:
            return "disabled; call /sorting/arm/enable with data: true"
        if self._job is not None:
            return f"busy with job {self._job.request_id} (grade {self._job.grade})"
        return None

    def _reason_to_ignore(self, stamp: Any, grade: str | None) -> str | None:
        now_s = self._node.get_clock().now().nanoseconds * 1e-9
        stamp_s = stamp.sec + stamp.nanosec * 1e-9  # rclpy's Time refuses the negative stamps that a message may have.
        stale = reason_not_fresh(stamp_s, now_s, self._settings.vision_max_age_s)
        if stale is not None:
            return stale
        return "none of its apples has a grade" if grade is None else self._reason_to_reject(grade)

    def _new_job(self, grade: str, feedback: Callable[[Any], None] | None) -> PickPlaceJob:
        self._jobs += 1

        def tell(state: State) -> None:
            self._publish(state)
            if state.feedback and feedback is not None:
                feedback(PickPlace.Feedback(request_id=state.request_id, phase=state.phase, message=state.message))

        return PickPlaceJob(self._jobs, grade, self._motions.of_job(), tell)

    async def _execute(self, handle: Any) -> Any:
        if self._job is None:  # This cannot happen, because _on_accepted has set the job.
            return PickPlace.Result(message="internal error: no job")
        result = await self._run(self._job)
        if result.ending is JobEnding.SUCCEEDED:
            handle.succeed()
        elif handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
        return PickPlace.Result(
            success=result.ending is JobEnding.SUCCEEDED,
            request_id=result.request_id,
            message=result.message,
        )

    async def _run(self, job: PickPlaceJob) -> Result:
        self._log.info(printable_line(f"job {job.request_id}: grade {job.grade}"))
        try:
            result = await job.run()
        finally:
            self._job = None
            if not self._idle.done():
                self._idle.set_result(None)
        text = printable_line(f"job {job.request_id} {result.ending.value}: {result.message}")
        if result.ending is JobEnding.SUCCEEDED:  # rclpy allows only one severity per line of code.
            self._log.info(text)
        else:
            self._log.error(text)
        return result

    def _publish(self, state: State) -> None:
        self._seq += 1
        time_s = self._node.get_clock().now().nanoseconds * 1e-9
        self._states.publish(String(data=state_json(self._seq, time_s, state)))
