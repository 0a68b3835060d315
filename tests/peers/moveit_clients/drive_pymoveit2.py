"""Call a plan server through pymoveit2, and print the results of all calls as one line of JSON."""

import json
import sys
import time
from typing import Any

import pymoveit2

READY = [0.0, -0.3643, -0.6419, -0.8154, -0.9541, -1.6828]
LEFT = [0.6, -0.3643, -0.6419, -0.8154, -0.9541, -1.6828]
FORWARD = [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
LIMIT_S = 30.0
SCENE_S = 5.0


def wait_for(condition: Any) -> bool:
    """Return whether a condition becomes true before a timeout."""
    end_s = time.monotonic() + SCENE_S
    while not condition():
        if time.monotonic() > end_s:
            return False
        time.sleep(0.05)
    return True


def names(arm: Any) -> tuple[set[str], set[str]]:
    """Return the names of the objects of the world and of the attached objects."""
    arm.update_planning_scene()
    scene = arm.planning_scene
    attached = scene.robot_state.attached_collision_objects
    return {item.id for item in scene.world.collision_objects}, {held.object.id for held in attached}


def move(robot: Any, found: dict[str, Any]) -> None:
    """Move to joint positions, to a pose, and along a straight line."""
    found["joint goal"] = robot.move_to_configuration(LEFT, timeout_sec=LIMIT_S)
    pose = robot.arm.compute_fk().pose
    at, turn = pose.position, pose.orientation
    quaternion = (turn.x, turn.y, turn.z, turn.w)
    found["back"] = robot.move_to_configuration(READY, timeout_sec=LIMIT_S)
    found["pose goal"] = robot.move_to_pose(
        position=(at.x, at.y, at.z), quat_xyzw=quaternion, tolerance_orientation=0.01, timeout_sec=LIMIT_S
    )
    reached = robot.arm.compute_fk().pose.position
    found["distance to the pose, m"] = max(abs(at.x - reached.x), abs(at.y - reached.y), abs(at.z - reached.z))
    found["line"] = robot.move_to_pose(
        position=(at.x, at.y, at.z + 0.03),
        quat_xyzw=quaternion,
        cartesian=True,
        cartesian_fraction_threshold=0.99,
        timeout_sec=LIMIT_S,
    )
    found["height of the line, m"] = robot.arm.compute_fk().pose.position.z - at.z


def change_scene(robot: Any, found: dict[str, Any]) -> None:
    """Add an object that blocks the path, attach an object to the tool, and remove both."""
    arm = robot.arm
    robot.move_to_configuration(READY, timeout_sec=LIMIT_S)
    at = arm.compute_fk(joint_state=LEFT).pose.position
    arm.add_collision_box(id="wall", size=(0.1, 0.1, 0.4), position=(at.x, at.y, 0.2), quat_xyzw=UPRIGHT)
    found["added"] = wait_for(lambda: "wall" in names(arm)[0])
    found["goal inside the wall"] = robot.move_to_configuration(LEFT, timeout_sec=LIMIT_S)
    found["reason"] = str(arm.last_failure())
    arm.remove_collision_object(id="wall")
    found["removed"] = wait_for(lambda: "wall" not in names(arm)[0])
    tool = arm.compute_fk().pose.position
    arm.add_collision_box(id="part", size=(0.02, 0.02, 0.02), position=(tool.x, tool.y, tool.z), quat_xyzw=UPRIGHT)
    links = ["gripper_base_link", "hand_left_link", "hand_right_link", "link5"]
    found["laid"] = wait_for(lambda: "part" in names(arm)[0])
    arm.attach_collision_object(id="part", link_name="gripper_base_link", touch_links=links)
    found["attached"] = wait_for(lambda: "part" in names(arm)[1])
    found["motion with the part"] = robot.move_to_configuration(LEFT, timeout_sec=LIMIT_S)
    arm.detach_collision_object(id="part")
    found["detached"] = wait_for(lambda: "part" in names(arm)[0] and "part" not in names(arm)[1])
    arm.remove_collision_object(id="part")
    found["all removed"] = wait_for(lambda: "part" not in names(arm)[0])


def cancel(robot: Any, found: dict[str, Any]) -> None:
    """Cancel a slow motion."""
    arm = robot.arm
    arm.max_velocity = arm.max_acceleration = 0.1
    found["slow motion"] = robot.move_to_configuration(FORWARD, wait=False, timeout_sec=LIMIT_S)
    time.sleep(1.0)
    arm.cancel_execution()
    found["canceled motion"] = arm.wait_until_executed(timeout_sec=LIMIT_S)
    arm.wait_for_joint_state(SCENE_S)
    state = dict(zip(arm.joint_state.name, arm.joint_state.position, strict=True))
    found["joint3 after the cancel"] = state["joint3"]


def main() -> int:
    """Run all steps."""
    found: dict[str, Any] = {}
    with pymoveit2.connect("pymoveit2_client", timeout_sec=LIMIT_S) as robot:
        robot.arm.wait_for_joint_state(LIMIT_S)
        for step in (move, change_scene, cancel):
            step(robot, found)
    print(json.dumps(found))
    return 0


if __name__ == "__main__":
    sys.exit(main())
