"""A third-party pick-and-place program that uses only the arm's action, the hand's topic and TF.

Usage: python tests/ros/foreign_pick_place.py A [B C ...]

The program runs one job per grade, without a pause after a gripper command. After the jobs, it checks where the cube is
and prints one line of JSON. The exit status is 0 only if every cube is in its bin.
"""

import json
import math
import sys
import time

import rclpy
from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Float64MultiArray
from tf2_msgs.msg import TFMessage
from trajectory_msgs.msg import JointTrajectoryPoint

JOINTS = ["joint1", "joint2", "joint3", "joint4", "joint5", "joint6"]
READY = [0.0, -0.3643, -0.6419, -0.8154, -0.9541, -1.6828]
PICK = [0.0, -0.35, -0.70, -0.70, -1.10, 1.55]
BINS = {
    "A": [0.4, -0.2, -0.8, -0.6, -1.1, 1.55],
    "B": [0.0, -0.2, -0.8, -0.6, -1.1, 1.55],
    "C": [-0.4, -0.2, -0.8, -0.6, -1.1, 1.55],
}
OPEN_M, CLOSED_M = 0.0, 0.05
BIN_RADIUS_M = 0.06
LOOK_S = 1.0
SUCCEEDED = 4  # action_msgs/msg/GoalStatus


class Robot(Node):  # type: ignore[misc]
    """Client of arm, hand and TF that sends its commands one after the other."""

    def __init__(self) -> None:
        super().__init__("foreign_pick_place")
        self.arm = ActionClient(self, FollowJointTrajectory, "/arm_controller/follow_joint_trajectory")
        self.hand = self.create_publisher(Float64MultiArray, "/hand_controller/commands", 10)
        self.frames: dict[str, tuple[float, float, float]] = {}
        latched = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.create_subscription(TFMessage, "/tf", self.on_tf, 100)
        self.create_subscription(TFMessage, "/tf_static", self.on_tf, latched)

    def on_tf(self, message: TFMessage) -> None:
        """Store the positions of all frames in the base frame, in m."""
        for transform in message.transforms:
            if transform.header.frame_id.lstrip("/") == "base_link":
                at = transform.transform.translation
                self.frames[transform.child_frame_id.lstrip("/")] = (at.x, at.y, at.z)

    def connect(self) -> None:
        """Wait until the arm's action and the hand's topic have subscribers."""
        if not self.arm.wait_for_server(timeout_sec=10.0):
            sys.exit("no action server /arm_controller/follow_joint_trajectory")
        deadline_s = time.monotonic() + 10.0
        while self.hand.get_subscription_count() == 0:
            if time.monotonic() > deadline_s:
                sys.exit("no subscriber on /hand_controller/commands")
            time.sleep(0.1)

    def move(self, positions: list[float]) -> None:
        """Send one goal in rad and wait for its end."""
        goal = FollowJointTrajectory.Goal()
        goal.trajectory.joint_names = JOINTS
        point = JointTrajectoryPoint(positions=positions)
        point.time_from_start.sec = 2
        goal.trajectory.points = [point]
        sent = self.arm.send_goal_async(goal)
        rclpy.spin_until_future_complete(self, sent, timeout_sec=3.0)
        if not sent.done() or not sent.result().accepted:
            sys.exit(f"the arm did not accept {positions}")
        result = sent.result().get_result_async()
        rclpy.spin_until_future_complete(self, result, timeout_sec=10.0)
        if not result.done() or result.result().status != SUCCEEDED:
            words = result.result().result.error_string if result.done() else "no result in 10 s"
            sys.exit(f"the arm did not reach {positions}: {words}")

    def grip(self, position: float) -> None:
        """Send a position to the fingers, in m, without waiting."""
        self.hand.publish(Float64MultiArray(data=[position]))

    def job(self, grade: str) -> None:
        """Run one job: ready, pick, bin, ready."""
        self.move(READY)
        self.grip(OPEN_M)
        self.move(PICK)
        self.grip(CLOSED_M)
        self.move(BINS[grade])
        self.grip(OPEN_M)
        self.move(READY)

    def look(self) -> tuple[list[float] | None, str | None]:
        """Return the position of the cube in m, and the bin that contains it."""
        self.frames.pop("cube", None)
        end_s = time.monotonic() + LOOK_S
        while time.monotonic() < end_s:
            rclpy.spin_once(self, timeout_sec=0.1)
        cube = self.frames.get("cube")
        if cube is None:
            return None, None
        away_m = {
            grade: math.dist(cube[:2], self.frames[f"bin_{grade}"][:2])
            for grade in BINS
            if f"bin_{grade}" in self.frames
        }
        nearest = min(away_m, key=away_m.__getitem__, default=None)
        inside = nearest is not None and away_m[nearest] <= BIN_RADIUS_M
        return [round(x, 4) for x in cube], nearest if inside else None


def main() -> int:
    """Run the jobs and return the exit status."""
    grades = sys.argv[1:]
    if not grades or any(grade not in BINS for grade in grades):
        sys.exit("usage: foreign_pick_place.py A|B|C ...")
    rclpy.init()
    robot = Robot()
    robot.connect()
    all_well = True
    for grade in grades:
        robot.job(grade)
        cube, found = robot.look()
        print(json.dumps({"grade": grade, "bin": found, "cube": cube}), flush=True)
        all_well = all_well and found == grade
    robot.destroy_node()
    rclpy.shutdown()
    return 0 if all_well else 1


if __name__ == "__main__":
    sys.exit(main())
