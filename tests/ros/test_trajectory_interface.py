"""The ROS interface of the trajectory controller when the ROS thread lags several cycles behind the loop."""

from collections.abc import Iterator
from typing import Any

import pytest
import rclpy
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTrajectoryControllerState
from control_msgs.srv import QueryTrajectoryState
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from hal.types import JointState
from nodes.controllers.trajectory import TrajectoryNode
from nodes.ros_process import spin_until_done
from tests.controller.bench import ARM, Bench
from tests.ros.stack_process import PATIENCE_S
from tests.ros.stamps import time_message
from tests.ros.trajectory_client import goal_of, point, stamp_s, trajectory


class Behind:
    """A trajectory interface with its client in one process. The test determines when cycles are published."""

    def __init__(self) -> None:
        self.node = Node("behind")
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.bench = Bench().up()
        self.cycles: list[JointState] = []
        self.bench.loop.on_cycle = self.cycles.append
        self.interface = TrajectoryNode(self.node, self.bench.arm)
        self.states: list[float] = []
        self.node.create_subscription(
            JointTrajectoryControllerState, "~/controller_state", lambda m: self.states.append(stamp_s(m)), 100
        )

    def show(self) -> None:
        for state in self.cycles:
            self.interface.publish_cycle(state, time_message(state.stamp_s))

    def wait(self, future: Any) -> Any:
        assert spin_until_done(self.executor, future, PATIENCE_S), "never came"
        return future.result()

    def settle(self) -> None:
        """Spin until pending messages have arrived."""
        for _ in range(50):
            self.executor.spin_once(timeout_sec=0.01)


@pytest.fixture
def behind(ros_domain: int) -> Iterator[Behind]:
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    behind = Behind()
    yield behind
    behind.executor.shutdown()
    behind.node.destroy_node()
    rclpy.try_shutdown()


def test_result_follows_the_states_of_all_cycles(behind: Behind) -> None:
    behind.bench.cycle(2)
    behind.show()
    behind.settle()
    action = ActionClient(behind.node, FollowJointTrajectory, "~/follow_joint_trajectory")
    goal = goal_of(trajectory(point((0.1, 0.1), 0.5), names=ARM))
    handle = behind.wait(action.send_goal_async(goal))
    result = handle.get_result_async()
    behind.cycles.clear()
    behind.states.clear()
    behind.bench.cycles_until(behind.bench.arm.settled)
    behind.show()
    behind.settle()
    assert not result.done()
    behind.interface.publish(time_message(behind.cycles[-1].stamp_s))
    assert behind.wait(result).result.error_code == 0
    shown = [pytest.approx(state.stamp_s, abs=1e-6) for state in behind.cycles]
    assert behind.states == shown and len(shown) > 10
    action.destroy()


def test_inactive_controller_answers_no_query_from_late_cycles(behind: Behind) -> None:
    query = behind.node.create_client(QueryTrajectoryState, "~/query_state")
    behind.bench.cycle(2)
    behind.show()
    request = QueryTrajectoryState.Request(time=time_message(behind.cycles[-1].stamp_s))
    assert list(behind.wait(query.call_async(request)).name) == list(ARM)
    behind.cycles.clear()
    behind.bench.cycle(2)
    behind.bench.manager.deactivate()
    behind.show()
    answer = behind.wait(query.call_async(request))
    assert (answer.success, answer.message) == (False, "Can't sample trajectory. Controller is not active.")
