"""Link poses as functions of joint positions. Quaternions are (x, y, z, w); lengths are in m."""

import math

from hal.robot_description.description import UrdfJoint, Vector

Quaternion = tuple[float, float, float, float]


def child_pose(joint: UrdfJoint, position: float) -> tuple[Vector, Quaternion]:
    """Return the pose of the child link in the frame of the parent link at a joint position (rad or m)."""
    origin = from_rpy(joint.rpy_rad)
    if joint.kind == "prismatic":
        x, y, z = joint.axis
        share = position / math.hypot(x, y, z)
        shift = rotate(origin, (x * share, y * share, z * share))
        a, b, c = joint.xyz_m
        return (a + shift[0], b + shift[1], c + shift[2]), origin
    if joint.kind in ("revolute", "continuous"):
        return joint.xyz_m, multiply(origin, about_axis(joint.axis, position))
    return joint.xyz_m, origin


def from_rpy(rpy_rad: Vector) -> Quaternion:
    """Convert roll, pitch and yaw about fixed axes, as in a URDF, to a quaternion."""
    roll, pitch, yaw = rpy_rad
    about_z = about_axis((0.0, 0.0, 1.0), yaw)
    about_y = about_axis((0.0, 1.0, 0.0), pitch)
    return multiply(multiply(about_z, about_y), about_axis((1.0, 0.0, 0.0), roll))


def about_axis(axis: Vector, angle_rad: float) -> Quaternion:
    """Return the rotation by an angle about an axis of any length."""
    length = math.hypot(*axis)
    share = math.sin(angle_rad / 2.0) / length
    return axis[0] * share, axis[1] * share, axis[2] * share, math.cos(angle_rad / 2.0)


def multiply(p: Quaternion, q: Quaternion) -> Quaternion:
    """Return the rotation that applies q first and then p."""
    px, py, pz, pw = p
    qx, qy, qz, qw = q
    return (
        pw * qx + px * qw + py * qz - pz * qy,
        pw * qy - px * qz + py * qw + pz * qx,
        pw * qz + px * qy - py * qx + pz * qw,
        pw * qw - px * qx - py * qy - pz * qz,
    )


def rotate(q: Quaternion, v: Vector) -> Vector:
    """Rotate a vector by a quaternion."""
    x, y, z, w = q
    turned = multiply(multiply(q, (v[0], v[1], v[2], 0.0)), (-x, -y, -z, w))
    return turned[0], turned[1], turned[2]
