"""Conversions between pose messages and poses of planning/."""

import numpy as np
from geometry_msgs.msg import Point, Quaternion, Vector3
from geometry_msgs.msg import Pose as PoseMessage

from hal.rotations import quaternions
from planning.kinematics.chain import ToolPose
from planning.scene import Pose


def pose_of(message: PoseMessage) -> Pose:
    """Convert a pose message to a pose. Raises PlanningError if the pose is not finite or the quaternion is not
    normalized."""
    return Pose.from_quaternion(vector_of(message.position), quaternion_of(message.orientation))


def pose_message(pose: Pose) -> PoseMessage:
    """Convert a pose to a pose message."""
    x, y, z, w = quaternions(pose.matrix).tolist()
    return PoseMessage(position=point_message(pose), orientation=Quaternion(x=x, y=y, z=z, w=w))


def point_message(pose: Pose) -> Point:
    """Return a pose's position as a Point message."""
    x, y, z = pose.position_m.tolist()
    return Point(x=x, y=y, z=z)


def tool_pose(pose: Pose) -> ToolPose:
    """Return a pose in the form used by goals."""
    return ToolPose(np.array(pose.position_m), quaternions(pose.matrix))


def vector_of(message: Point | Vector3) -> tuple[float, float, float]:
    """Return the components of a point or a vector."""
    return message.x, message.y, message.z


def quaternion_of(message: Quaternion) -> tuple[float, float, float, float]:
    """Return the components x, y, z, w of a quaternion."""
    return message.x, message.y, message.z, message.w


def is_identity(message: PoseMessage) -> bool:
    """Return whether a pose message has its default value."""
    return vector_of(message.position) == (0.0, 0.0, 0.0) and quaternion_of(message.orientation) == (0.0, 0.0, 0.0, 1.0)
