"""Tests of the built interfaces between two processes over the real middleware: actions, a service and topics."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.ros

PEER = Path(__file__).with_name("round_trip_peer.py")
PATIENCE_S = 30.0


@pytest.fixture(scope="module")
def node():
    rclpy = pytest.importorskip("rclpy")
    # A separate domain, because other tests or a robot may use the same machine.
    domain = os.getpid() % 100 + 1
    environment = os.environ | {"ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    peer = subprocess.Popen([sys.executable, PEER], stdin=subprocess.PIPE, env=environment)
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    node = rclpy.create_node("round_trip", context=context)
    executor = rclpy.executors.SingleThreadedExecutor(context=context)
    executor.add_node(node)
    node.executor = executor
    yield node
    executor.shutdown()
    node.destroy_node()
    context.shutdown()
    peer.stdin.close()
    assert peer.wait(timeout=PATIENCE_S) == 0


def spin_until(node, condition):
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, "no answer"
        node.executor.spin_once(timeout_sec=0.1)


def answer(node, future):
    spin_until(node, future.done)
    return future.result()


def run_action(node, kind, name, goal):
    from rclpy.action import ActionClient

    client = ActionClient(node, kind, name)
    assert client.wait_for_server(PATIENCE_S)
    feedback = []

    def run():
        sent = client.send_goal_async(goal, feedback_callback=lambda message: feedback.append(message.feedback))
        handle = answer(node, sent)
        assert handle.accepted
        result = answer(node, handle.get_result_async()).result
        node.executor.spin_once(timeout_sec=0.1)
        return result

    result = run()
    # The services may be discovered before the feedback topic. Feedback that is sent in the meantime is lost.
    for _ in range(20):
        if feedback:
            break
        result = run()
    client.destroy()
    assert feedback
    return result, feedback


def test_follow_joint_trajectory(node):
    from control_msgs.action import FollowJointTrajectory
    from trajectory_msgs.msg import JointTrajectoryPoint

    goal = FollowJointTrajectory.Goal()
    goal.trajectory.joint_names = ["joint1", "joint2"]
    goal.trajectory.points = [JointTrajectoryPoint(positions=[0.1, -0.2])]
    result, feedback = run_action(node, FollowJointTrajectory, "/follow", goal)
    assert (result.error_code, result.error_string) == (FollowJointTrajectory.Result.SUCCESSFUL, "1 point")
    assert list(feedback[0].joint_names) == ["joint1", "joint2"]


def test_pick_place(node):
    from sorting_arm_interfaces.action import PickPlace

    result, feedback = run_action(node, PickPlace, "/pick", PickPlace.Goal(grade="B"))
    assert (result.success, result.request_id, result.message) == (True, 7, "B")
    assert (feedback[0].request_id, feedback[0].phase) == (7, "grasp")


def test_service(node):
    from controller_manager_msgs.srv import ListControllers

    client = node.create_client(ListControllers, "/list")
    assert client.wait_for_service(PATIENCE_S)
    controllers = answer(node, client.call_async(ListControllers.Request())).controller
    assert [(controller.name, controller.update_rate) for controller in controllers] == [("arm_controller", 20)]


def test_topics(node):
    from apple_quality_msgs.msg import AppleQualityArray
    from control_msgs.msg import JointTrajectoryControllerState
    from tf2_msgs.msg import TFMessage

    got = {}
    topics = {"/transforms": TFMessage, "/apples": AppleQualityArray, "/state": JointTrajectoryControllerState}
    for topic, kind in topics.items():
        node.create_subscription(kind, topic, lambda message, topic=topic: got.setdefault(topic, message), 10)
    spin_until(node, lambda: len(got) == len(topics))
    assert got["/transforms"].transforms[0].child_frame_id == "cube"
    assert got["/apples"].apples[0].grade == "B"
    assert list(got["/state"].joint_names) == ["joint1"]
