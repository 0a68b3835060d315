"""All clients receive their responses, even if one of them floods the action with goals."""

import json
import subprocess
import sys
import time

import pytest
from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionClient
from rclpy.qos import QoSProfile, qos_profile_services_default

from nodes.publishing import EVERY_CALL
from tests.ros.manager_client import ManagerClient
from tests.ros.stack_process import PATIENCE_S, StackProcess
from tests.ros.test_large_messages import ACTION, trajectory

FLOOD_HZ, FLOOD_S = 500, 4
PATIENT_S = 10.0
"""Maximum response time for a normal client on a machine that is busy with the flood."""
UNREAD_S = 2.0
"""Maximum time until a response has arrived and the client has read it."""
FLOODER = f"""
import json, sys, time
from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionClient
from nodes.clients.client_node import client_node
from nodes.publishing import EVERY_CALL
from tests.ros.stack_process import JOINTS, READY, PATIENCE_S
from trajectory_msgs.msg import JointTrajectoryPoint

with client_node("flooder") as (node, executor):
    # By default, a client queues only ten responses, including those to all other clients.
    client = ActionClient(
        node,
        FollowJointTrajectory,
        "/arm_controller/follow_joint_trajectory",
        goal_service_qos_profile=EVERY_CALL,
    )
    assert client.wait_for_server(PATIENCE_S)
    goal = FollowJointTrajectory.Goal()
    goal.trajectory.joint_names = list(JOINTS)
    goal.trajectory.points = [JointTrajectoryPoint(positions=list(READY))]
    goal.trajectory.points[0].time_from_start.sec = 2
    print("begins", flush=True)
    answers, due_s = [], time.monotonic()
    end_s = due_s + {FLOOD_S}
    while due_s < end_s:
        answers.append(client.send_goal_async(goal))
        due_s += 1 / {FLOOD_HZ}
        executor.spin_once(timeout_sec=max(0.0, due_s - time.monotonic()))
    patient_s = time.monotonic() + PATIENCE_S
    while not all(answer.done() for answer in answers) and time.monotonic() < patient_s:
        executor.spin_once(timeout_sec=0.1)
    done = [answer for answer in answers if answer.done()]
    print(json.dumps([len(answers), len(done), sum(answer.result().accepted for answer in done)]), flush=True)
"""


@pytest.mark.parametrize(("queue", "kept"), [(qos_profile_services_default, False), (EVERY_CALL, True)])
def test_default_queue_of_a_client_loses_a_response_after_ten_others(
    client: ManagerClient, stack: StackProcess, queue: QoSProfile, kept: bool
) -> None:
    """The stack has responded in both cases. The queue of a client receives the responses to all clients of the
    action."""
    others = ManagerClient("others")
    actions = [ActionClient(one.node, FollowJointTrajectory, ACTION, goal_service_qos_profile=qos)
               for one, qos in ((client, queue), (others, EVERY_CALL))]  # fmt: skip
    try:
        assert all(action.wait_for_server(PATIENCE_S) for action in actions)
        goal = FollowJointTrajectory.Goal(trajectory=trajectory(1))
        answer = actions[0].send_goal_async(goal)
        time.sleep(UNREAD_S)
        for _ in range(qos_profile_services_default.depth):
            others.wait(actions[1].send_goal_async(goal))
        client.executor.spin_until_future_complete(answer, UNREAD_S)
        assert answer.done() == kept
    finally:
        for action in actions:
            action.destroy()
        others.close()


def test_normal_client_is_served_during_a_flood(client: ManagerClient, stack: StackProcess) -> None:
    action = ActionClient(client.node, FollowJointTrajectory, ACTION, goal_service_qos_profile=EVERY_CALL)
    assert action.wait_for_server(PATIENCE_S)
    goal = FollowJointTrajectory.Goal(trajectory=trajectory(1))
    flooder = subprocess.Popen([sys.executable, "-c", FLOODER], stdout=subprocess.PIPE, text=True)
    took_s: list[float] = []
    try:
        assert flooder.stdout is not None and flooder.stdout.readline() == "begins\n"
        while len(took_s) < 2 * FLOOD_S:
            begin_s = time.monotonic()
            (handle,) = client.wait(action.send_goal_async(goal))
            took_s.append(time.monotonic() - begin_s)
            assert handle.accepted
            time.sleep(0.25)
        sent, answered, accepted = json.loads(flooder.stdout.readline())
    finally:
        flooder.kill()
        flooder.wait()
        action.destroy()
    assert max(took_s) < PATIENT_S
    assert answered == sent and 0 < accepted < sent
    assert stack.words.count("goals come too often") < 100
    assert "Traceback" not in stack.words
