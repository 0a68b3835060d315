"""Second process of test_round_trip.py: it serves both actions and a service until its input is closed."""

import sys
import threading

import rclpy
from apple_quality_msgs.msg import AppleQuality, AppleQualityArray
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTrajectoryControllerState
from controller_manager_msgs.msg import ControllerState
from controller_manager_msgs.srv import ListControllers
from geometry_msgs.msg import TransformStamped
from rclpy.action import ActionServer
from rclpy.executors import ExternalShutdownException
from sorting_arm_interfaces.action import PickPlace
from tf2_msgs.msg import TFMessage


def follow(goal):
    names = list(goal.request.trajectory.joint_names)
    goal.publish_feedback(FollowJointTrajectory.Feedback(joint_names=names))
    goal.succeed()
    return FollowJointTrajectory.Result(error_string=f"{len(goal.request.trajectory.points)} point")


def pick(goal):
    goal.publish_feedback(PickPlace.Feedback(request_id=7, phase="grasp"))
    goal.succeed()
    return PickPlace.Result(success=True, request_id=7, message=goal.request.grade)


def list_controllers(_, response):
    response.controller = [ControllerState(name="arm_controller", update_rate=20)]
    return response


def publish_all(publishers):
    transform = TransformStamped(child_frame_id="cube")
    transform.transform.translation.x = 0.27
    publishers[0].publish(TFMessage(transforms=[transform]))
    publishers[1].publish(AppleQualityArray(apples=[AppleQuality(grade="B", diameter_mm=80.0)]))
    publishers[2].publish(JointTrajectoryControllerState(joint_names=["joint1"], speed_scaling_factor=1.0))


def main():
    rclpy.init()
    node = rclpy.create_node("round_trip_peer")
    servers = [
        ActionServer(node, FollowJointTrajectory, "/follow", follow),
        ActionServer(node, PickPlace, "/pick", pick),
        node.create_service(ListControllers, "/list", list_controllers),
    ]
    topics = ((TFMessage, "/transforms"), (AppleQualityArray, "/apples"), (JointTrajectoryControllerState, "/state"))
    publishers = [node.create_publisher(kind, topic, 10) for kind, topic in topics]
    node.create_timer(0.1, lambda: publish_all(publishers))
    threading.Thread(target=lambda: (sys.stdin.read(), rclpy.try_shutdown()), daemon=True).start()
    try:
        rclpy.spin(node)
    except ExternalShutdownException:
        del servers


main()
