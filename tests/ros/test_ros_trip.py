"""Count the files on the path from an action goal to its controller, and from a cycle to /joint_states."""

import threading
from collections.abc import Iterator
from contextlib import ExitStack
from types import SimpleNamespace
from typing import Any

import pytest
from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionClient, GoalResponse
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from trajectory_msgs.msg import JointTrajectoryPoint

from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from hal.types import JointState
from nodes.controllers.forward import ForwardNode
from nodes.controllers.trajectory import TrajectoryNode
from nodes.rclpy_patches import gil_release, rcl_calls
from nodes.stack import Stack
from nodes.stack_nodes import StackNodes
from servoloop.simulation.stack import SimulatedStack
from tests.stack.rig import ARM, PICK
from tests.stack.trip import TripRecorder

PATIENCE_S = 30.0
GOAL = ["trajectory_goals", "parameter_node", "rcl_calls", "fair_rate"]
JOINT_STATES = ["stack_nodes", "spinning", "ros_time", "controller_nodes", "broadcasters", "publishing", "rcl_calls"]


class InProcess:
    """A stack in simulated time with its ROS nodes in this thread and a client in another thread."""

    def __init__(self) -> None:
        self.rig = SimulatedStack().up()
        files = self.rig.files
        factory: Any = SimpleNamespace(file=files.controllers)
        self.ros_nodes = StackNodes(
            Stack(self.rig.loop, files.description, files.component, {}, dict, {}, factory, relax=False)
        )
        self.rig.loop.on_cycle = self.ros_nodes.post
        self.node = Node("client")
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.action = ActionClient(self.node, FollowJointTrajectory, "/arm_controller/follow_joint_trajectory")
        self._client = threading.Thread(target=self.executor.spin, name="client")
        self._client.start()

    def cycles(self, count: int) -> None:
        for _ in range(count):
            self.rig.loop.step()
            self.serve(0.05)

    def serve(self, seconds: float, done: threading.Event | None = None) -> None:
        """Spin the ROS nodes for a time or until a condition is true."""
        over = done or threading.Event()
        timer = threading.Timer(seconds, over.set)
        timer.start()
        self.ros_nodes.spin(over.is_set)
        timer.cancel()

    def close(self) -> None:
        self.rig.manager.deactivate()
        self.cycles(2)  # The client receives the result of its goal.
        self.executor.shutdown()
        self._client.join()
        self.action.destroy()
        self.node.destroy_node()
        self.ros_nodes.close()


@pytest.fixture
def stack(ros_domain: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[InProcess]:
    for owner, name, function in gil_release.replacements():
        monkeypatch.setattr(owner, name, function)  # The change is permanent in the process.
    stack = InProcess()
    yield stack
    stack.close()


def own(files: list[str]) -> list[str]:
    """Return the files of nodes/, by file name."""
    return [name.rpartition("/")[2].removesuffix(".py") for name in files if name.startswith("nodes/")]


def test_goal_passes_few_files_from_callback_to_controller(stack: InProcess) -> None:
    stack.cycles(2)
    assert stack.action.wait_for_server(PATIENCE_S)
    goal = FollowJointTrajectory.Goal()
    goal.trajectory.joint_names = list(ARM)
    goal.trajectory.points = [JointTrajectoryPoint(positions=list(PICK))]
    goal.trajectory.points[0].time_from_start.sec = 2
    first = threading.Event()  # This call also caches the information about each message type.
    stack.action.send_goal_async(goal).add_done_callback(lambda _: first.set())
    stack.serve(PATIENCE_S, first)
    trip = TripRecorder(until=JointTrajectoryController.submit)
    answered = threading.Event()
    with ExitStack() as recording:

        def begin(offered: FollowJointTrajectory.Goal) -> GoalResponse:
            recording.enter_context(trip.recording())
            return goals._on_goal(offered)

        interface: Any = stack.ros_nodes._controllers._nodes["arm_controller"]._interface
        goals = interface._goals
        goals._server.register_goal_callback(begin)
        answer = stack.action.send_goal_async(goal)
        answer.add_done_callback(lambda _: answered.set())
        stack.serve(PATIENCE_S, answered)
    assert answer.result().accepted
    assert own(trip.files) == GOAL


def test_cycle_passes_few_files_from_post_to_message(stack: InProcess) -> None:
    stack.cycles(2)
    states: list[JointState] = []
    stack.rig.loop.on_cycle = states.append
    stack.rig.loop.step()
    others = [TrajectoryNode.publish_cycle, TrajectoryNode.publish, ForwardNode.publish]
    trip = TripRecorder(until=rcl_calls._Kind.sent, muted=others)
    with trip.recording():
        stack.ros_nodes._publish_cycles(states[-1:])
    assert own(trip.files) == JOINT_STATES
