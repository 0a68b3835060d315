"""Conversions between robot state messages and positions of the driven joints."""

import math
from collections.abc import Mapping

from moveit_msgs.msg import AttachedCollisionObject, RobotState
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from nodes.planning.edits import WorldEdit
from nodes.planning.request_errors import RequestError
from nodes.planning.world import PlanningWorld
from planning.motion import State
from planning.robot import PlanningRobot
from planning.scene import Scene


def state_of(robot: PlanningRobot, message: RobotState, current: State) -> dict[str, float]:
    """Return the robot state in a message. Joints that the message does not contain keep their current positions.

    Raises:
        RequestError: The number of positions differs from the number of names.
        PlanningError: A joint does not exist, or a position is not finite.
    """
    names, positions = message.joint_state.name, message.joint_state.position
    if len(names) != len(positions):
        counts = f"{len(names)} joints and {len(positions)} positions"
        raise RequestError("INVALID_ROBOT_STATE", f"the state has {counts}: send one position for each joint")
    if message.multi_dof_joint_state.joint_names:
        raise RequestError(
            "INVALID_ROBOT_STATE",
            f"{message.multi_dof_joint_state.joint_names[0]} is a multi-DOF joint, but the robot has no such joint",
        )
    return robot.state({**current, **dict(zip(names, map(float, positions), strict=True))})


def world_of(robot: PlanningRobot, message: RobotState, world: PlanningWorld, state: State) -> PlanningWorld:
    """Return the world with the attached objects of a state. Raises RequestError or PlanningError."""
    if not message.attached_collision_objects:
        return world
    edit = WorldEdit(robot, world, lambda: state)
    for held in message.attached_collision_objects:
        edit.apply_attached(held)
    return edit.world


def joint_message(robot: PlanningRobot, state: State) -> JointState:
    """Return a state as a message, including the mimic joints."""
    positions = {**state, **followers(robot, state)}
    message = JointState(name=list(positions), position=list(positions.values()))
    message.header = Header(frame_id=robot.frame)
    return message


def state_message(robot: PlanningRobot, state: State, world: PlanningWorld | None = None) -> RobotState:
    """Return a state as a message, with the attached objects of a world."""
    message = RobotState(joint_state=joint_message(robot, state))
    if world is not None:
        message.attached_collision_objects = attached_messages(world.scene, world)
    return message


def attached_messages(scene: Scene, world: PlanningWorld) -> list[AttachedCollisionObject]:
    """Return the messages of the attached objects."""
    return [
        AttachedCollisionObject(
            link_name=held.link, object=world.items[name], touch_links=sorted({held.link, *held.touch_links})
        )
        for name, held in scene.attached.items()
    ]


def followers(robot: PlanningRobot, state: State) -> Mapping[str, float]:
    """Return the positions of the mimic joints."""
    found = {}
    for name, joint in robot.description.joints.items():
        mimic = joint.mimic
        if mimic is not None and name not in state and mimic.joint in state:
            position = mimic.multiplier * state[mimic.joint] + mimic.offset
            if math.isfinite(position):
                found[name] = position
    return found
