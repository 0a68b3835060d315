"""A stack with a plan server, each in its own process, for programs that plan."""

import shlex
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import rclpy
from rclpy.node import Node

from nodes.planning_client.presence import is_planner_present
from tests.ros.stack_process import StackProcess, running, until

PROGRAM_S = 150.0


@contextmanager
def planned_stack(folder: Path, *arguments: str, arm: str = "robot_arm", namespace: str = "") -> Iterator[StackProcess]:
    """Run ``servoloop up`` with a plan server until the end of the block, and yield the plan server."""
    options = ("--arm", arm, "--namespace", namespace)
    with running(folder, *options, *arguments):
        server = StackProcess(folder / "plan_server.log", "plan-server", *options)
        try:
            wait_for_planner(server, namespace)
            yield server
        finally:
            server.end()


@contextmanager
def planning_up(folder: Path, command: str) -> Iterator[StackProcess]:
    """Run a ``servoloop up --plan`` until the end of the block."""
    stack = StackProcess(folder / "up.log", *shlex.split(command)[1:])
    try:
        wait_for_planner(stack)
        yield stack
    finally:
        assert stack.end() == 0, stack.words


def wait_for_planner(server: StackProcess, namespace: str = "") -> None:
    """Wait until the plan server provides its actions."""
    context = rclpy.Context()
    rclpy.init(context=context)
    node = Node("wait_for_planner", context=context, namespace=namespace)
    until(lambda: is_planner_present(node), lambda: server.process.poll() is not None and server.words)
    node.destroy_node()
    context.shutdown()


def program(*command: str) -> str:
    """Run a Python program and return its output. The call fails with the program's error output if the program
    fails."""
    ran = subprocess.run([sys.executable, *command], capture_output=True, text=True, timeout=PROGRAM_S, check=False)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    return ran.stdout


def servoloop(*arguments: str, limit_s: float = PROGRAM_S) -> subprocess.CompletedProcess[str]:
    """Run a ``servoloop`` command and return its result."""
    command = [sys.executable, "-m", "servoloop", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=limit_s, check=False)
