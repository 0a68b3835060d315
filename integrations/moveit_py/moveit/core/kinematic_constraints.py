"""Create goals as constraints of joints and links."""

from collections.abc import Sequence

from geometry_msgs.msg import Pose, PoseStamped, Quaternion
from moveit_msgs.msg import Constraints, JointConstraint, OrientationConstraint, PositionConstraint
from shape_msgs.msg import SolidPrimitive

from moveit.core.robot_model import JointModelGroup
from moveit.core.robot_state import RobotState

JOINT_TOLERANCE = 1e-4
"""Tolerance of MoveIt's joint goals, in rad or m."""
POSITION_TOLERANCE_M = 1e-3
ORIENTATION_TOLERANCE_RAD = 1e-2


def construct_joint_constraint(
    robot_state: RobotState, joint_model_group: JointModelGroup, tolerance: float = JOINT_TOLERANCE
) -> Constraints:
    """Return constraints that keep the joints of a group within ``tolerance`` (rad or m) of a state."""
    positions = robot_state.joint_positions
    return Constraints(
        joint_constraints=[
            JointConstraint(
                joint_name=name,
                position=positions[name],
                tolerance_above=tolerance,
                tolerance_below=tolerance,
                weight=1.0,
            )
            for name in joint_model_group.active_joint_model_names
        ]
    )


def construct_link_constraint(
    link_name: str,
    source_frame: str,
    cartesian_position: Sequence[float] | None = None,
    cartesian_position_tolerance: float | None = None,
    orientation: Sequence[float] | None = None,
    orientation_tolerance: float | None = None,
) -> Constraints:
    """Return constraints of a link's position (m) and orientation (quaternion x, y, z, w) in a frame.

    Args:
        link_name: Name of the link.
        source_frame: Frame in which the values are given.
        cartesian_position: Position x, y, z, in m.
        cartesian_position_tolerance: Radius around the position, in m.
        orientation: Quaternion x, y, z, w.
        orientation_tolerance: Tolerance about each axis, in rad.
    """
    constraints = Constraints()
    if cartesian_position is not None:
        radius_m = POSITION_TOLERANCE_M if cartesian_position_tolerance is None else cartesian_position_tolerance
        constraints.position_constraints = [_position(link_name, source_frame, cartesian_position, radius_m)]
    if orientation is not None:
        tolerance = ORIENTATION_TOLERANCE_RAD if orientation_tolerance is None else orientation_tolerance
        constraints.orientation_constraints = [_orientation(link_name, source_frame, orientation, tolerance)]
    return constraints


def pose_constraints(pose: PoseStamped, link_name: str) -> Constraints:
    """Return constraints that move a link to a pose, with MoveIt's default tolerances."""
    at, turn = pose.pose.position, pose.pose.orientation
    frame = pose.header.frame_id
    return construct_link_constraint(link_name, frame, (at.x, at.y, at.z), orientation=(turn.x, turn.y, turn.z, turn.w))


def _position(link: str, frame: str, position_m: Sequence[float], radius_m: float) -> PositionConstraint:
    constraint = PositionConstraint(link_name=link, weight=1.0)
    constraint.header.frame_id = frame
    center = Pose(orientation=Quaternion(w=1.0))
    center.position.x, center.position.y, center.position.z = map(float, position_m)
    constraint.constraint_region.primitives = [SolidPrimitive(type=SolidPrimitive.SPHERE, dimensions=[radius_m])]
    constraint.constraint_region.primitive_poses = [center]
    return constraint


def _orientation(link: str, frame: str, quaternion: Sequence[float], tolerance_rad: float) -> OrientationConstraint:
    x, y, z, w = map(float, quaternion)
    constraint = OrientationConstraint(
        link_name=link,
        orientation=Quaternion(x=x, y=y, z=z, w=w),
        absolute_x_axis_tolerance=tolerance_rad,
        absolute_y_axis_tolerance=tolerance_rad,
        absolute_z_axis_tolerance=tolerance_rad,
        weight=1.0,
    )
    constraint.header.frame_id = frame
    return constraint
