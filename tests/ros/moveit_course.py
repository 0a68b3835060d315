"""The program of the MoveIt course: plan and execute with MoveIt's Python interface."""

import rclpy
from geometry_msgs.msg import PoseStamped
from moveit.core.robot_state import RobotState
from moveit.planning import MoveItPy

rclpy.init()
robot = MoveItPy(node_name="course")
arm = robot.get_planning_component("arm")
hand = robot.get_planning_component("hand")

# A goal in joint positions.
state = RobotState(robot.get_robot_model())
state.set_joint_group_positions("arm", [0.4, -0.2, -0.8, -0.6, -1.1, 1.55])
arm.set_start_state_to_current_state()
arm.set_goal_state(robot_state=state)
plan = arm.plan()
moved = bool(plan) and bool(robot.execute(plan.trajectory, controllers=[]))

# A pose of the tool, mirrored to the other side.
goal = PoseStamped()
goal.header.frame_id = "base_link"
state.set_joint_group_positions("arm", [-0.4, -0.2, -0.8, -0.6, -1.1, 1.55])
goal.pose = state.get_pose("gripper_base_link")
arm.set_start_state_to_current_state()
arm.set_goal_state(pose_stamped_msg=goal, pose_link="gripper_base_link")
plan = arm.plan()
posed = bool(plan) and bool(robot.execute(plan.trajectory, controllers=[]))

# A named state of the hand.
hand.set_start_state_to_current_state()
hand.set_goal_state("close")
plan = hand.plan()
closed = bool(plan) and bool(robot.execute(plan.trajectory, controllers=[]))
hand.set_start_state_to_current_state()
hand.set_goal_state("open")
plan = hand.plan()
opened = bool(plan) and bool(robot.execute(plan.trajectory, controllers=[]))

robot.shutdown()
rclpy.shutdown()
print(f"arm: {moved}, pose: {posed}, hand: {closed and opened}")
