"""The pick-and-place node in its own process, with its environment in the process of the test."""

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Self

import rclpy
from apple_quality_msgs.msg import AppleQuality, AppleQualityArray
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from sorting_arm_interfaces.action import PickPlace
from std_msgs.msg import String
from std_srvs.srv import SetBool

from tests.ros.fake_arm import FakeArm, Plan

DEADLINE_S = 30.0
STORY = [
    "start", "ready", "ready", "open_gripper", "grasp", "grasp", "close_gripper", "place", "place",
    "release", "done", "done",
]  # fmt: skip
FEEDBACK = ["start", "ready", "grasp", "place"]


def wait_until(condition: Callable[[], Any], what: str) -> None:
    """Wait for a condition, and fail with the message ``what`` after a deadline."""
    deadline_s = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < deadline_s, f"not within {DEADLINE_S} s: {what}"
        time.sleep(0.005)


def finished(future: Any, what: str) -> Any:
    """Return the result of a future that another thread sets."""
    wait_until(future.done, what)
    return future.result()


class Pick:
    """One goal for the node under test."""

    def __init__(self, client: ActionClient, grade: str, heard: Sequence[Any]) -> None:
        """Send a goal. ``heard`` receives every feedback message of all goals."""
        self._heard = heard
        sent = client.send_goal_async(PickPlace.Goal(grade=grade))
        self._handle = finished(sent, "the response to the goal")
        self.accepted: bool = self._handle.accepted

    def cancel(self) -> None:
        """Request a cancel, and check that the cancel is accepted."""
        answer = finished(self._handle.cancel_goal_async(), "the response to the cancel")
        assert len(answer.goals_canceling) == 1

    def end(self) -> tuple[int, Any]:
        """Wait for the end of the goal, and return the status (action_msgs/GoalStatus) and the result."""
        response = finished(self._handle.get_result_async(), "the result")
        return response.status, response.result

    @property
    def feedback(self) -> list[Any]:
        """All feedback of the goal so far."""
        ours = bytes(self._handle.goal_id.uuid)
        return [message.feedback for message in self._heard if bytes(message.goal_id.uuid) == ours]

    def phases(self) -> list[str]:
        """All phases in the feedback so far."""
        return [feedback.phase for feedback in self.feedback]


class Cell:
    """Context manager with the node under test, a fake arm (or none) and clients of the node."""

    def __init__(self, domain: int, log: Path, arguments: Sequence[str] = (), arm: bool = True) -> None:
        self._log = log
        with log.open("wb") as output:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "nodes.vision_pick_place_controller", *arguments],
                env=os.environ | {"ROS_DOMAIN_ID": str(domain)},
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        self.states: list[dict[str, Any]] = []
        self.sights = 0
        self._accepted = 0
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=domain)
        self.node = rclpy.create_node(f"cell_{domain}", context=self._context)
        self._nodes = [self.node]
        self.arm = None
        if arm:
            self._nodes.append(rclpy.create_node("fake_arm", context=self._context))
            self.arm = FakeArm(self._nodes[-1])
        self.node.create_subscription(String, "/sorting/arm/state", self._on_state, 10)
        # rclpy's action client drops feedback that arrives after the result, so the test subscribes to the topic.
        self._feedback: list[Any] = []
        message_type, topic = PickPlace.Impl.FeedbackMessage, "/sorting/arm/pick_place/_action/feedback"
        self.node.create_subscription(message_type, topic, self._feedback.append, 10)
        self._client = ActionClient(self.node, PickPlace, "/sorting/arm/pick_place")
        self._enable = self.node.create_client(SetBool, "/sorting/arm/enable")
        self._vision = self.node.create_publisher(AppleQualityArray, "/sorting/perception/apple_quality", 10)
        # One thread per node, because rclpy's multi-threaded executor sometimes misses an event.
        self._executors = [SingleThreadedExecutor(context=self._context) for _ in self._nodes]
        self._threads = [threading.Thread(target=e.spin, daemon=True) for e in self._executors]

    def __enter__(self) -> Self:
        for node, executor, thread in zip(self._nodes, self._executors, self._threads, strict=True):
            executor.add_node(node)
            thread.start()
        wait_until(self._client.server_is_ready, "the node's action server")
        wait_until(self._enable.service_is_ready, "the node's service")
        wait_until(lambda: self._vision.get_subscription_count() == 1, "the node's subscription")
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait()
        for executor in self._executors:
            executor.shutdown()
        for thread in self._threads:
            thread.join()
        self._client.destroy()
        if self.arm is not None:
            self.arm.close()
        for node in self._nodes:
            node.destroy_node()
        self._context.shutdown()

    def below(self) -> FakeArm:
        """Fake arm of the cell."""
        assert self.arm is not None
        return self.arm

    def lose_arm(self) -> None:
        """Destroy the node of the arm, even during a motion."""
        self._executors.pop().shutdown()
        self._threads.pop().join()
        self.below().close()
        self._nodes.pop().destroy_node()
        self.arm = None

    def forget(self, *plans: Plan) -> None:
        """Start a test with empty records and with plans for the next goals of the arm."""
        # A result may arrive before the last states, but these states must not reach the next test.
        wait_until(lambda: self._ends() >= self._accepted, "the end of every accepted job")
        self.clear(*plans)

    def _ends(self) -> int:
        return self.phases().count("error") + self.phases().count("done") // 2

    def clear(self, *plans: Plan) -> None:
        """Do the work of ``forget``, but do not wait for messages that may be lost."""
        self.states.clear()
        self._feedback.clear()
        self._accepted = 0
        if self.arm is not None:
            self.arm.forget(*plans)

    def pick(self, grade: str) -> Pick:
        """Send a goal and wait for the response."""
        pick = Pick(self._client, grade, self._feedback)
        self._accepted += pick.accepted
        return pick

    def phases(self) -> list[str]:
        """All phases in the states so far."""
        return [state["phase"] for state in self.states]

    def wait_for_end(self) -> None:
        """Wait for the final state of a job."""
        wait_until(lambda: self.phases()[-1:] == ["error"] or self.phases()[-2:] == ["done"] * 2, "the last state")

    def wait_for_goals(self, count: int) -> None:
        """Wait until the arm has received a number of goals."""
        wait_until(lambda: len(self.below().goals) >= count, f"goal {count} of the arm")

    def enable(self, data: bool) -> Any:
        """Call the enable service."""
        return finished(self._enable.call_async(SetBool.Request(data=data)), "the service")

    def see(self, *grades: str, age_s: float | None = 0.0) -> None:
        """Publish a vision message of a given age, or without a stamp if the age is None."""
        message = AppleQualityArray(apples=[AppleQuality(grade=grade) for grade in grades])
        if age_s is not None:
            stamp_ns = self.node.get_clock().now().nanoseconds - int(age_s * 1e9)
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 1_000_000_000)
        self._vision.publish(message)
        self.sights += 1

    def see_until(self, condition: Callable[[], bool], *grades: str, age_s: float | None = 0.0) -> None:
        """Publish a message repeatedly, because the first messages may be lost during discovery."""

        def see_and_look() -> bool:
            self.see(*grades, age_s=age_s)
            time.sleep(0.05)
            return condition()

        wait_until(see_and_look, "the effect of the vision messages")

    def log(self) -> str:
        """Return the output of the node."""
        return self._log.read_text(errors="replace")

    def wait_for_log(self, words: str, count: int = 1) -> None:
        """Wait until the node has printed these words a given number of times."""
        wait_until(lambda: self.log().count(words) >= count, f"{words!r} in the log:\n{self.log()}")

    def _on_state(self, message: Any) -> None:
        self.states.append(json.loads(message.data))
