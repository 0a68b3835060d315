"""The node ``vision_pick_place_controller``: picks the apple and puts it into the bin of its grade.

Everything runs in one thread, that of a SingleThreadedExecutor: callbacks never overlap, so neither
the job nor the flags below need a lock. A job is a task of that executor; it awaits, never blocks.
"""

import sys
from collections.abc import Callable, Sequence
from typing import Any

import rclpy
from apple_quality_msgs.msg import AppleQualityArray
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.time import Time
from sorting_arm_interfaces.action import PickPlace
from std_msgs.msg import String
from std_srvs.srv import SetBool

from nodes import pick_place_parameters as parameters
from nodes.leaving import leaving
from nodes.pick_place_arm import RosArm
from nodes.pick_place_job import Ending, PickPlaceJob, Result, State
from nodes.pick_place_settings import normal_grade
from nodes.pick_place_signals import on_stop_signal
from nodes.pick_place_state import state_json
from nodes.pick_place_vision import candidate, reason_not_fresh
from nodes.pick_place_waiting import Waiter

NODE_NAME = "vision_pick_place_controller"
_LOG_EVERY_S = 5.0
_LAST_WORDS_S = 0.1
_DISCOVERY_S = 4.0
"""Before the first job: two participants see each other at the next announcement of one of them, every 3 s (Fast DDS),
and a job waits for the arm for 2 s only."""


class VisionPickPlaceController:
    """The node's ROS surface; what a job does is in ``PickPlaceJob``."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._log = node.get_logger()
        self._settings = parameters.declare(node)
        self._arm = RosArm(node, self._settings)
        self._waiter = Waiter(node)
        self._enabled = True
        self._stopping = False
        self._job: PickPlaceJob | None = None
        self._idle = Future()
        self._seq = 0
        self._jobs = 0
        self._states = node.create_publisher(String, "/sorting/arm/state", 10)
        node.create_subscription(AppleQualityArray, "/sorting/perception/apple_quality", self._on_vision, 10)
        node.create_service(SetBool, "/sorting/arm/enable", self._on_enable)
        if not self._arm.look(_DISCOVERY_S):
            self._log.warning("the arm is not there yet: a job will wait for it, but not for long")
        self._server = self._serve(parameters.action_name(node))
        self._log.info(f"ready for goals; grades {', '.join(self._settings.bins_rad)}")

    async def stop(self) -> None:
        """Take no more jobs, cancel the running one, and let its result leave."""
        self._stopping = True
        if self._job is not None:
            self._log.info("told to stop: canceling the running job")
            self._idle = Future()
            self._job.cancel("canceled: the node was told to stop")
            self._waiter.wake()
            await self._waiter.until(self._longest_cancel_s(), self._idle)
            await self._waiter.until(_LAST_WORDS_S)

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
        )

    # --- what comes in -----------------------------------------------------------------------

    def _on_goal(self, goal: Any) -> GoalResponse:
        reason = self._reason_to_reject(goal.grade)
        if reason is None:
            return GoalResponse.ACCEPT
        self._log.warning(f"goal rejected: {reason}")
        return GoalResponse.REJECT

    def _on_accepted(self, handle: Any) -> None:
        # not in _on_goal: were the answer to the client lost, the node would be busy for ever
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
            # a camera repeats itself many times a second
            self._log.warning(f"vision message ignored: {reason}", throttle_duration_sec=_LOG_EVERY_S)
            return
        self._job = self._new_job(grade or "", None)
        self._node.executor.create_task(self._run, self._job)

    def _reason_to_reject(self, grade: str) -> str | None:
        if self._stopping:
            return "the node is stopping"
        if not normal_grade(grade):
            return f"the grade is empty; known grades: {', '.join(self._settings.bins_rad)}"
        if not self._enabled:
            return "disabled; call /sorting/arm/enable with data: true"
        if self._job is not None:
            return f"busy with job {self._job.request_id} (grade {self._job.grade})"
        return None

    def _reason_to_ignore(self, stamp: Any, grade: str | None) -> str | None:
        now_s = self._node.get_clock().now().nanoseconds * 1e-9
        stamp_s = Time.from_msg(stamp).nanoseconds * 1e-9
        stale = reason_not_fresh(stamp_s, now_s, self._settings.vision_max_age_s)
        if stale is not None:
            return stale
        return "no apple in it has a grade" if grade is None else self._reason_to_reject(grade)

    # --- the job -----------------------------------------------------------------------------

    def _new_job(self, grade: str, feedback: Callable[[Any], None] | None) -> PickPlaceJob:
        self._jobs += 1

        def tell(state: State) -> None:
            self._publish(state)
            if state.feedback and feedback is not None:
                feedback(PickPlace.Feedback(request_id=state.request_id, phase=state.phase, message=state.message))

        return PickPlaceJob(self._jobs, grade, self._settings, self._arm, tell)

    async def _execute(self, handle: Any) -> Any:
        if self._job is None:  # cannot be: _on_accepted has set it
            return PickPlace.Result(message="internal error: no job")
        result = await self._run(self._job)
        if result.ending is Ending.SUCCEEDED:
            handle.succeed()
        elif handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
        return PickPlace.Result(
            success=result.ending is Ending.SUCCEEDED,
            request_id=result.request_id,
            message=result.message,
        )

    async def _run(self, job: PickPlaceJob) -> Result:
        self._log.info(f"job {job.request_id}: grade {job.grade}")
        try:
            result = await job.run()
        finally:
            self._job = None
            if not self._idle.done():
                self._idle.set_result(None)
        words = f"job {job.request_id} {result.ending.value}: {result.message}"
        if result.ending is Ending.SUCCEEDED:  # rclpy wants one severity a line of code
            self._log.info(words)
        else:
            self._log.error(words)
        return result

    def _publish(self, state: State) -> None:
        self._seq += 1
        time_s = self._node.get_clock().now().nanoseconds * 1e-9
        self._states.publish(String(data=state_json(self._seq, time_s, state)))


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM; the exit status. ``args`` as in ``sys.argv``."""
    # rclpy's own handlers close the middleware at once, and then the arm could not be told to stop
    rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    executor = SingleThreadedExecutor()
    stopped = Future()

    async def stop() -> None:
        await controller.stop()
        stopped.set_result(None)

    on_stop_signal(lambda: executor.create_task(stop))
    node = rclpy.create_node(NODE_NAME)
    executor.add_node(node)
    try:
        controller = VisionPickPlaceController(node)
        executor.spin_until_future_complete(stopped)
    except (ValueError, ParameterException, NameValidationException) as error:
        node.get_logger().fatal(f"wrong parameters: {error}")
        return 2
    finally:
        with leaving():
            executor.shutdown()
            node.destroy_node()
            rclpy.shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
