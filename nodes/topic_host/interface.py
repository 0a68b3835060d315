"""Run the node of an arm that another controller manager drives. One thread receives commands, and another thread
publishes states."""

import threading
from collections.abc import Callable, Sequence
from functools import partial
from time import monotonic

import rclpy

from controller.host.host_controller import HostController
from hal.types import JointState
from nodes.cycle_publisher import CyclePublisher
from nodes.ros_process import exit_watchdog, rcl_errors
from nodes.ros_time import RosTime
from nodes.spinning import FINISH_S, WAKE_S, errors_logged, executor_of, serve, start_rclpy
from nodes.stack import Stack
from nodes.topic_host.node import HostNode
from nodes.topic_host.topics import HostTopics


class TopicHostInterface:
    """ROS 2 interface of a stack that another controller manager drives. The interface has one node and no services."""

    def __init__(self, stack: Stack, controller: HostController, topics: HostTopics) -> None:
        self._send_delayed = start_rclpy(stack.namespace)
        self._turn = threading.Lock()
        """Lock that is held by the thread that is using the node: the executor during callbacks, or the cycle
        publisher."""
        self._publisher = CyclePublisher(self._publish_cycles)
        self._ros_time = ros_time = RosTime(stack.loop.clock, stack.simulation is not None)
        with rcl_errors():
            self._host = HostNode(stack, controller, topics, ros_time)
        self._executor = executor_of(self._host.node, self._turn)
        self._executor.add_node(self._host.node)
        self._publisher.start()

    def post(self, state: JointState) -> None:
        """Pass a completed cycle to its publisher without blocking."""
        self._publisher.post(state)

    def wake(self) -> None:
        """Wake the ROS thread. This method does not block."""
        self._executor.post()

    def wait_until_published(self, longest_s: float) -> bool:
        """Wait at most ``longest_s`` seconds until all cycles are published. Return whether they were published in
        time."""
        return self._publisher.wait_until_published(longest_s)

    def spin(self, stop: Callable[[], bool]) -> None:
        """Receive commands until ``stop`` returns True. An error in a callback is logged and does not end this loop.

        Raises:
            RosError: This stack has just started, but another stack with the same name is running.
        """
        others = self._host.others
        self._serve(lambda: stop() or others.must_end)
        others.require_none()

    def finish(self) -> None:
        """Publish the last states after the control loop has stopped."""
        self._publisher.stop()
        deadline_s = monotonic() + FINISH_S
        self._serve(lambda: monotonic() > deadline_s)

    def close(self) -> None:
        """Remove the node from the graph."""
        with exit_watchdog():
            self._publisher.stop()
            self._executor.shutdown(timeout_sec=1.0)
            self._host.node.destroy_node()
            rclpy.try_shutdown()

    def _serve(self, stop: Callable[[], bool]) -> None:
        serve(stop, (partial(self._executor.serve, WAKE_S), self._send_delayed))

    def _publish_cycles(self, states: Sequence[JointState]) -> None:
        with errors_logged(), self._turn:
            offset_s = self._ros_time.offset_s()
            for state in states:
                self._host.publish(state, self._ros_time.stamp(state.stamp_s + offset_s))
