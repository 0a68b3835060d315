"""Messages for the move_group node: goals for the arm, straight lines, and planning scene changes."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from moveit_msgs.action import MoveGroup
from moveit_msgs.msg import AttachedCollisionObject, PlanningScene
from moveit_msgs.srv import GetCartesianPath

from nodes.planning_client import goals
from nodes.planning_client.scenes import change, object_message
from pick_place.pose_settings import PoseSettings, ToolPose
from planning.scene import Box, Pose, SceneObject

LINE_STEP_M: Final = 0.01
"""Distance between consecutive poses on a straight line, in m."""


def joint_goal(settings: PoseSettings, positions_rad: Sequence[float]) -> MoveGroup.Goal:
    """Return the goal for a motion to the given joint positions."""
    constraints = goals.joint_constraints(dict(zip(settings.joints, positions_rad, strict=True)))
    return goals.motion_goal(settings.group, constraints, settings.speed, settings.planning_time_s)


def pose_goal(settings: PoseSettings, pose: ToolPose) -> MoveGroup.Goal:
    """Return the goal for a motion that moves the tool to a pose."""
    constraints = goals.pose_constraints(settings.tool_link, settings.frame, pose[:3], pose[3:])
    return goals.motion_goal(settings.group, constraints, settings.speed, settings.planning_time_s)


def line(settings: PoseSettings, pose: ToolPose) -> GetCartesianPath.Request:
    """Return the request for a straight line from the current tool pose to ``pose``."""
    request = GetCartesianPath.Request(
        group_name=settings.group,
        link_name=settings.tool_link,
        waypoints=[goals.pose_message(pose[:3], pose[3:])],
        max_step=LINE_STEP_M,
        avoid_collisions=True,
        max_velocity_scaling_factor=settings.speed,
        max_acceleration_scaling_factor=settings.speed,
    )
    request.header.frame_id = settings.frame
    request.start_state.is_diff = True
    return request


def laid(settings: PoseSettings) -> PlanningScene:
    """Return the scene change that adds the object at its position before picking."""
    return change([object_message(_object(settings), settings.frame)])


def attached(settings: PoseSettings) -> PlanningScene:
    """Return the scene change that attaches the object to the tool. The object is at its position before picking."""
    held = AttachedCollisionObject(
        link_name=settings.tool_link,
        object=object_message(_object(settings), settings.frame),
        touch_links=list(settings.target.touch_links),
    )
    return change([], [held])


def _object(settings: PoseSettings) -> SceneObject:
    target = settings.target
    x_m, y_m, z_m = target.size_m
    return SceneObject(target.name, ((Box(x_m, y_m, z_m), Pose()),), Pose(np.array(target.position_m)))
