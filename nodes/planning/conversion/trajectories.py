"""Conversions between trajectory messages and timed paths."""

import math
from collections.abc import Sequence

import numpy as np
from builtin_interfaces.msg import Duration
from moveit_msgs.msg import RobotTrajectory
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from hal.types import FloatArray
from nodes.planning.request_errors import RequestError
from planning.motion import Motion
from planning.paths.timing import TimedPath


def trajectory_message(motion: Motion, frame: str) -> RobotTrajectory:
    """Return the message for a motion that begins at time 0."""
    path = motion.path
    rows = zip(path.times_s, path.positions, path.velocities, path.accelerations, strict=True)
    points = [
        JointTrajectoryPoint(
            positions=positions.tolist(),
            velocities=velocities.tolist(),
            accelerations=accelerations.tolist(),
            time_from_start=duration(float(time_s)),
        )
        for time_s, positions, velocities, accelerations in rows
    ]
    own = JointTrajectory(header=Header(frame_id=frame), joint_names=list(motion.joints), points=points)
    return RobotTrajectory(joint_trajectory=own)


def duration(seconds: float) -> Duration:
    """Return the message for a time in seconds."""
    nanoseconds = round(seconds * 1e9)
    return Duration(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)


def seconds_of(message: Duration) -> float:
    """Return a time in seconds."""
    return float(message.sec) + float(message.nanosec) * 1e-9


def checked_points(message: JointTrajectory) -> None:
    """Check the points of a client's trajectory.

    Raises:
        RequestError: There are no points, a point lacks a finite position for a joint, or the times do not increase.
    """
    if not message.points or not message.joint_names:
        raise _invalid("the trajectory has no points: plan first")
    if len(set(message.joint_names)) < len(message.joint_names):
        raise _invalid(f"the trajectory names a joint twice: {', '.join(message.joint_names)}")
    before_s = -1.0
    for number, point in enumerate(message.points):
        if len(point.positions) != len(message.joint_names):
            raise _invalid(f"point {number} has {len(point.positions)} positions for {len(message.joint_names)} joints")
        for what, values in (("velocities", point.velocities), ("accelerations", point.accelerations)):
            if len(values) not in (0, len(message.joint_names)) or not all(map(math.isfinite, values)):
                raise _invalid(f"point {number} has invalid {what}: send a finite value for each joint, or none")
        for joint, position in zip(message.joint_names, point.positions, strict=True):
            if not math.isfinite(position):
                raise _invalid(f"point {number}: the position of {joint} is {position}. Send finite numbers")
        now_s = seconds_of(point.time_from_start)
        if now_s <= before_s:
            raise _invalid(
                f"point {number} is at {now_s:g} s, which is not after the previous point: plan the times again"
            )
        before_s = now_s


def part(message: JointTrajectory, joints: Sequence[str]) -> JointTrajectory:
    """Return the part of a trajectory that concerns the given joints."""
    columns = [message.joint_names.index(joint) for joint in joints]

    def chosen(values: Sequence[float]) -> list[float]:
        return [values[column] for column in columns] if len(values) else []

    points = [
        JointTrajectoryPoint(
            positions=chosen(point.positions),
            velocities=chosen(point.velocities),
            accelerations=chosen(point.accelerations),
            time_from_start=point.time_from_start,
        )
        for point in message.points
    ]
    return JointTrajectory(header=message.header, joint_names=list(joints), points=points)


def timed_path(message: JointTrajectory, joints: Sequence[str], start: Sequence[float]) -> TimedPath:
    """Convert a client's trajectory to a path of a group's joints (n).

    Args:
        message: The trajectory.
        joints: Joints of the group. Joints that the trajectory does not contain stay at their start positions.
        start: Positions (n,) of the joints at the start, in rad or m.
    """
    times_s = np.array([seconds_of(point.time_from_start) for point in message.points])
    positions = np.tile(np.asarray(start, dtype=float), (len(times_s), 1))
    for column, joint in enumerate(joints):
        if joint in message.joint_names:
            index = message.joint_names.index(joint)
            positions[:, column] = [point.positions[index] for point in message.points]
    if len(times_s) == 1 or times_s[0] > 0.0:
        times_s = np.concatenate([[0.0], times_s + (1e-9 if times_s[0] == 0.0 else 0.0)])
        positions = np.concatenate([np.asarray(start, dtype=float)[None], positions])
    zeros: FloatArray = np.zeros_like(positions)
    return TimedPath(times_s, positions, zeros, zeros)


def _invalid(message: str) -> RequestError:
    return RequestError("INVALID_MOTION_PLAN", message)
