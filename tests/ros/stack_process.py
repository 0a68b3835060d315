"""The stack in its own process, and a client of the arm in the process of the test."""

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import rclpy
from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future
from trajectory_msgs.msg import JointTrajectoryPoint

JOINTS = tuple(f"joint{i}" for i in range(1, 7))
READY = (0.0, -0.3643, -0.6419, -0.8154, -0.9541, -1.6828)
PICK = (0.0, -0.35, -0.70, -0.70, -1.10, 1.55)
PATIENCE_S = 60.0


class StackProcess:
    """A ``servoloop`` command that runs until it is ended. ``words`` is its output."""

    def __init__(self, log: Path, *arguments: str, module: str = "servoloop") -> None:
        self._log = log
        with log.open("wb") as out:
            self.process = subprocess.Popen(
                [sys.executable, "-m", module, *arguments], stdout=out, stderr=subprocess.STDOUT
            )

    @property
    def words(self) -> str:
        return self._log.read_text(errors="replace")

    def wait_for(self, path: Path) -> None:
        until(path.exists, lambda: self.process.poll() is not None and self.words)

    def end(self, number: int = signal.SIGINT) -> int:
        """Send a signal if the process is still running, wait for its end, and return the exit status."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        return self.process.wait(PATIENCE_S)


def until(ready: Callable[[], bool], failed: Callable[[], object] = lambda: None) -> None:
    """Wait for a condition. Fail after a timeout, or as soon as ``failed`` returns a reason."""
    deadline_s = time.monotonic() + PATIENCE_S
    while not ready():
        if words := failed():
            raise AssertionError(words)
        assert time.monotonic() < deadline_s, "never came"
        time.sleep(0.02)


@contextmanager
def running(folder: Path, *arguments: str, module: str = "servoloop") -> Iterator[StackProcess]:
    """Run ``servoloop up`` until the end of the block. It is ready for goals."""
    ready = folder / "ready"
    stack = StackProcess(folder / "up.log", "up", "--ready-file", str(ready), *arguments, module=module)
    try:
        stack.wait_for(ready)
        yield stack
    finally:
        stack.end()


@contextmanager
def emulating(folder: Path, *arguments: str) -> Iterator[Path]:
    """Run ``servoloop emulate`` until the end of the block and yield the link."""
    link = folder / "bus"
    emulator = StackProcess(folder / "emulate.log", "emulate", str(link), *arguments)
    try:
        emulator.wait_for(link)
        yield link
    finally:
        emulator.end()


class ArmClient:
    """A client of the arm's action on its own node. ``namespace`` is that of the stack."""

    def __init__(self, name: str = "test_client", namespace: str = "") -> None:
        self.node = Node(name)
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        action = f"{namespace}/arm_controller/follow_joint_trajectory"
        self._client = ActionClient(self.node, FollowJointTrajectory, action)
        assert self._client.wait_for_server(PATIENCE_S)

    def send(self, positions: Sequence[float], seconds: int = 2) -> Future:
        """Send a goal with one point, and return the future of its (status, error_code, error_string)."""
        goal = FollowJointTrajectory.Goal()
        goal.trajectory.joint_names = list(JOINTS)
        point = JointTrajectoryPoint(positions=list(positions))
        point.time_from_start.sec = seconds
        goal.trajectory.points = [point]
        handle = self.wait(self._client.send_goal_async(goal))
        assert handle.accepted
        self.handle = handle
        future: Future = handle.get_result_async()
        return future

    def wait(self, future: Future) -> Any:
        """Wait for the result of a future. Fail after a timeout."""
        self.spin_until(future.done)
        return future.result()

    def spin_until(self, ready: Callable[[], bool]) -> None:
        deadline_s = time.monotonic() + PATIENCE_S
        while not ready():
            assert time.monotonic() < deadline_s, "never came"
            self.executor.spin_once(timeout_sec=0.1)

    def close(self) -> None:
        self.executor.shutdown()
        self._client.destroy()  # ``destroy_node`` leaves action clients behind.
        self.node.destroy_node()


@contextmanager
def arm_client() -> Iterator[ArmClient]:
    """Provide a client with its own ROS context."""
    rclpy.init()
    client = ArmClient()
    try:
        yield client
    finally:
        client.close()
        rclpy.try_shutdown()
