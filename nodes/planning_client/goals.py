"""Goals for the /move_action action, and descriptions of MoveIt's error codes."""

from collections.abc import Mapping, Sequence
from typing import Final

from geometry_msgs.msg import Point, Pose, Quaternion
from moveit_msgs.action import MoveGroup
from moveit_msgs.msg import (
    Constraints,
    JointConstraint,
    MoveItErrorCodes,
    OrientationConstraint,
    PositionConstraint,
)
from shape_msgs.msg import SolidPrimitive

JOINT_TOLERANCE_RAD: Final = 1e-3
POSITION_TOLERANCE_M: Final = 1e-3
ORIENTATION_TOLERANCE_RAD: Final = 1e-2
ATTEMPTS: Final = 3
_CODES: Final = {
    getattr(MoveItErrorCodes, name): name
    for name in vars(type(MoveItErrorCodes))
    if name.isupper() and isinstance(getattr(MoveItErrorCodes, name), int)
}


def error_text(code: MoveItErrorCodes) -> str:
    """Return the name of an error code and, if available, its message."""
    name = _CODES.get(code.val, f"error code {code.val}")
    return f"{name}: {code.message}" if code.message else f"{name}; the log of move_group may contain the reason"


def joint_constraints(positions: Mapping[str, float]) -> Constraints:
    """Return constraints of joint positions in rad or m, keyed by joint name."""
    return Constraints(
        joint_constraints=[
            JointConstraint(
                joint_name=joint,
                position=position,
                tolerance_above=JOINT_TOLERANCE_RAD,
                tolerance_below=JOINT_TOLERANCE_RAD,
                weight=1.0,
            )
            for joint, position in positions.items()
        ]
    )


def pose_constraints(
    link: str, frame: str, position_m: Sequence[float], quaternion: Sequence[float] | None
) -> Constraints:
    """Return constraints that move a link to a pose.

    Args:
        link: Name of the link.
        frame: Frame of the pose.
        position_m: Position x, y, z.
        quaternion: Orientation x, y, z, w. If None, the orientation is free.
    """
    center = pose_message(position_m, (0.0, 0.0, 0.0, 1.0))
    position = PositionConstraint(link_name=link, weight=1.0)
    position.header.frame_id = frame
    sphere = SolidPrimitive(type=SolidPrimitive.SPHERE, dimensions=[POSITION_TOLERANCE_M])
    position.constraint_region.primitives, position.constraint_region.primitive_poses = [sphere], [center]
    constraints = Constraints(position_constraints=[position])
    if quaternion is not None:
        constraints.orientation_constraints = [_orientation(link, frame, quaternion)]
    return constraints


def _orientation(link: str, frame: str, quaternion: Sequence[float]) -> OrientationConstraint:
    orientation = OrientationConstraint(
        link_name=link,
        orientation=pose_message((0.0, 0.0, 0.0), quaternion).orientation,
        absolute_x_axis_tolerance=ORIENTATION_TOLERANCE_RAD,
        absolute_y_axis_tolerance=ORIENTATION_TOLERANCE_RAD,
        absolute_z_axis_tolerance=ORIENTATION_TOLERANCE_RAD,
        weight=1.0,
    )
    orientation.header.frame_id = frame
    return orientation


def motion_goal(group: str, constraints: Constraints, speed: float, planning_time_s: float) -> MoveGroup.Goal:
    """Return the goal to plan a motion of a group from its current state and, optionally, to execute it.

    Args:
        group: Planning group.
        constraints: Constraints of the goal.
        speed: Fraction of the velocity and acceleration limits.
        planning_time_s: Maximum time to plan, in seconds.
    """
    goal = MoveGroup.Goal()
    request = goal.request
    request.group_name, request.goal_constraints = group, [constraints]
    request.num_planning_attempts, request.allowed_planning_time = ATTEMPTS, planning_time_s
    request.max_velocity_scaling_factor = request.max_acceleration_scaling_factor = speed
    request.start_state.is_diff = True
    goal.planning_options.planning_scene_diff.is_diff = True
    goal.planning_options.planning_scene_diff.robot_state.is_diff = True
    return goal


def pose_message(position_m: Sequence[float], quaternion: Sequence[float]) -> Pose:
    """Return a message for a position x, y, z in m and a quaternion x, y, z, w."""
    x, y, z = map(float, position_m)
    return Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(**dict(zip("xyzw", quaternion, strict=True))))
