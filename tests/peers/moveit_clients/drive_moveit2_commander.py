"""Call a plan server through moveit2_commander, and print the results of all calls as one line of JSON.

moveit2_commander imports all names of three packages without using them. ROS 2 from wheels does not contain these
packages, so they are replaced by empty modules.
"""

import importlib
import json
import sys
import threading
import time
from types import ModuleType
from typing import Any

import rclpy
from geometry_msgs.msg import Pose
from moveit_msgs.msg import AttachedCollisionObject, CollisionObject, PlanningScene
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import JointState
from shape_msgs.msg import SolidPrimitive
from std_msgs.msg import Header

for absent in ("nav_msgs", "nav_msgs.msg", "visualization_msgs", "visualization_msgs.msg", "tf2_ros"):
    sys.modules.setdefault(absent, ModuleType(absent))

commander: Any = importlib.import_module("moveit2_commander")

JOINTS = [f"joint{n}" for n in range(1, 7)]
READY = [0.0, -0.3643, -0.6419, -0.8154, -0.9541, -1.6828]
LEFT = [0.6, -0.3643, -0.6419, -0.8154, -0.9541, -1.6828]
STATE_S = 10.0
TOOL = "gripper_base_link"


def joints(positions: list[float]) -> JointState:
    return JointState(name=[*JOINTS, "hand_right_joint"], position=[*positions, 0.0])


def box(name: str, position_m: tuple[float, float, float], size_m: list[float]) -> CollisionObject:
    item = CollisionObject(header=Header(frame_id="base_link"), id=name, operation=CollisionObject.ADD)
    item.pose.orientation.w = 1.0
    item.pose.position.x, item.pose.position.y, item.pose.position.z = position_m
    item.primitives, item.primitive_poses = [SolidPrimitive(type=SolidPrimitive.BOX, dimensions=size_m)], [Pose()]
    item.primitive_poses[0].orientation.w = 1.0
    return item


def change() -> PlanningScene:
    scene = PlanningScene(is_diff=True)
    scene.robot_state.is_diff = True
    return scene


def present(node: Any) -> list[float]:
    """Return the present joint positions."""
    received: list[JointState] = []
    subscription = node.create_subscription(JointState, "/joint_states", received.append, 1)
    end_s = time.monotonic() + STATE_S
    while not received and time.monotonic() < end_s:
        time.sleep(0.05)
    node.destroy_subscription(subscription)
    positions = dict(zip(received[0].name, received[0].position, strict=True))
    return [positions[joint] for joint in JOINTS]


def plan(planner: Any, start: list[float], goal: list[float]) -> Any:
    constraints = planner.get_goal_constraint(JointState(name=JOINTS, position=goal), tolerance=0.001)
    return planner.run([constraints], None, joints(start))


def use(node: Any) -> dict[str, Any]:
    """Plan, execute, and change the scene."""
    found: dict[str, Any] = {}
    planner = commander.KinematicPath_ServiceManager(node, planning_group="arm")
    executor = commander.ExecuteTrajectory_ServiceManager(node)
    scene = commander.ApplyPlanningScene_ServiceManager(node)

    executor.run(plan(planner, present(node), READY))
    to_left = plan(planner, READY, LEFT)
    found["joint goal"] = executor.run(to_left).result.error_code.val
    slow = executor.scale_trajectory(plan(planner, LEFT, READY), 0.5)
    found["scaled trajectory"] = executor.run(slow).result.error_code.val

    found["added"] = scene.run([box("wall", (0.2, 0.15, 0.2), [0.1, 0.1, 0.4])], change())
    found["goal inside the wall"] = plan(planner, READY, LEFT) is not None
    gone = CollisionObject(id="wall", operation=CollisionObject.REMOVE)
    found["removed"] = scene.run([gone], change())

    forward = commander.FK_ServiceManager(node)
    pose = forward.run(joint_states=joints(READY), end_effector=TOOL).pose
    held = change()
    part = box("part", (pose.position.x, pose.position.y, pose.position.z), [0.02, 0.02, 0.02])
    links = [TOOL, "hand_left_link", "hand_right_link", "link5"]
    held.robot_state.attached_collision_objects = [
        AttachedCollisionObject(link_name=TOOL, object=part, touch_links=links)
    ]
    found["attached"] = scene.run([], held)
    pose.position.z += 0.03
    line = commander.CartesianPath_ServiceManager(node, planning_group="arm")
    path = line.run(Header(frame_id="base_link"), [pose], joints(READY), end_effector=TOOL)
    found["line"] = path is not None and executor.run(path).result.error_code.val
    loose = change()
    loose.robot_state.attached_collision_objects = [
        AttachedCollisionObject(object=CollisionObject(id="part", operation=CollisionObject.REMOVE))
    ]
    found["detached"] = scene.run([CollisionObject(id="part", operation=CollisionObject.REMOVE)], loose)
    return found


def main() -> int:
    """Run all steps in the main thread, while another thread spins the node."""
    rclpy.init()
    node = rclpy.create_node("commander")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    spinning = threading.Thread(target=executor.spin, daemon=True)
    spinning.start()
    print(json.dumps(use(node)), flush=True)
    executor.shutdown()
    spinning.join(5.0)
    rclpy.shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
