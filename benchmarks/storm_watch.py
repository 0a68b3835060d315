"""Observe the stack during a flood of clients. A DDS participant records the /joint_states stamps and the control
loop's statistics."""

import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState

from benchmarks.ros import PATIENCE_S
from nodes.ros_process import exit_watchdog


@contextmanager
def participant(name: str) -> Iterator[tuple[Node, SingleThreadedExecutor]]:
    """Provide a client with its own DDS participant."""
    context = Context()
    rclpy.init(context=context, domain_id=int(os.environ["ROS_DOMAIN_ID"]))
    node = Node(name, context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    try:
        yield node, executor
    finally:
        with exit_watchdog():
            executor.shutdown(timeout_sec=1.0)
            node.destroy_node()
            context.try_shutdown()


@dataclass(slots=True)
class StormWatch:
    """Observer that listens to the stack in a separate thread."""

    stamps_s: list[float] = field(default_factory=list)
    position: list[float] = field(default_factory=list)
    missed: int = 0
    reports: int = 0
    _stop: threading.Event = field(default_factory=threading.Event)

    def run(self) -> None:
        """Listen until the method ``end`` is called."""
        with participant("bench_watch") as (node, executor):
            node.create_subscription(JointState, "/joint_states", self._on_state, 1000)
            node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 100)
            while not self._stop.is_set():
                executor.spin_once(timeout_sec=0.1)

    def end(self) -> None:
        """Stop listening."""
        self._stop.set()

    def wait_for_report(self) -> None:
        """Wait for the next report from the loop, so that ``missed`` is up to date."""
        before, deadline_s = self.reports, time.monotonic() + PATIENCE_S
        while self.reports < before + 2:
            assert time.monotonic() < deadline_s, "the stack has stopped reporting"
            time.sleep(0.05)

    def _on_state(self, message: JointState) -> None:
        self.stamps_s.append(message.header.stamp.sec + message.header.stamp.nanosec * 1e-9)
        self.position = list(message.position)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == "servoloop: control loop":
                self.missed = int({v.key: v.value for v in status.values}["missed_cycles"])
                self.reports += 1
