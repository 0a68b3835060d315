"""Between ROS messages and the types of the core."""

from collections.abc import Sequence

from builtin_interfaces.msg import Duration, Time
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTolerance
from geometry_msgs.msg import TransformStamped
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from controller.goal import ERASE, GoalPoint, Tolerances, TrajectoryGoal
from controller.motion import Kinematics
from hal.types import FloatArray

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


def seconds(stamp: Duration | Time) -> float:
    """A ROS time or duration in seconds."""
    return float(stamp.sec) + float(stamp.nanosec) * 1e-9


def time_message(stamp_s: float) -> Time:
    """Seconds since the epoch as a ROS time."""
    nanoseconds = round(stamp_s * 1e9)
    return Time(sec=nanoseconds // 1_000_000_000, nanosec=nanoseconds % 1_000_000_000)


def trajectory_goal(goal: FollowJointTrajectory.Goal, now_s: float) -> TrajectoryGoal:
    """An action goal; ``now_s`` is ROS time, against which its stamp counts."""
    tolerances = Tolerances(
        path={t.name: _tolerance(t) for t in goal.path_tolerance},
        goal={t.name: _tolerance(t) for t in goal.goal_tolerance},
        goal_time_s=seconds(goal.goal_time_tolerance),
    )
    return trajectory_of(goal.trajectory, now_s, tolerances)


def _tolerance(message: JointTolerance) -> float:
    """The position's. Those of velocity and acceleration have no effect on position commands, but if they
    make no sense, then as upstream the whole tolerance makes none."""
    others = (message.velocity, message.acceleration)
    return next((float(other) for other in others if other < 0.0 and other != ERASE), float(message.position))


NO_TOLERANCES = Tolerances()


def trajectory_of(
    message: JointTrajectory, now_s: float, tolerances: Tolerances = NO_TOLERANCES, from_topic: bool = False
) -> TrajectoryGoal:
    """A trajectory; ``now_s`` is ROS time, against which its stamp counts."""
    stamp_s = seconds(message.header.stamp)
    points = tuple(
        GoalPoint(
            tuple(point.positions),
            seconds(point.time_from_start),
            tuple(point.velocities),
            tuple(point.accelerations),
            has_effort=bool(point.effort),
        )
        for point in message.points
    )
    delay_s = stamp_s - now_s if stamp_s else 0.0
    return TrajectoryGoal(tuple(message.joint_names), points, tolerances, delay_s, from_topic)


def point_message(
    position: FloatArray | Sequence[float],
    velocity: FloatArray | Sequence[float] = (),
    acceleration: FloatArray | Sequence[float] = (),
) -> JointTrajectoryPoint:
    """One point; arrays of shape (n,), or empty."""
    return JointTrajectoryPoint(positions=list(position), velocities=list(velocity), accelerations=list(acceleration))


def kinematics_message(state: Kinematics) -> JointTrajectoryPoint:
    """A full point."""
    return point_message(state.position, state.velocity, state.acceleration)


def transform_message(
    parent: str, child: str, position_m: Vector, quaternion: Quaternion, stamp: Time
) -> TransformStamped:
    """Where ``child`` is in ``parent``: metres and a unit quaternion (x, y, z, w)."""
    message = TransformStamped()
    message.header.frame_id = parent
    message.header.stamp = stamp
    message.child_frame_id = child
    place, turn = message.transform.translation, message.transform.rotation
    place.x, place.y, place.z = position_m
    turn.x, turn.y, turn.z, turn.w = quaternion
    return message
