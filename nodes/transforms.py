"""Compute the transforms of a robot's links. Constant parts are computed once, and the other parts in every cycle."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Transform, TransformStamped

from hal.robot_description.description import Mimic, UrdfJoint, Vector
from hal.robot_description.kinematics import Quaternion, child_pose, from_rpy, multiply, rotate

Place = Callable[[Transform, float], None]
"""Function that updates a transform for its joint's position (rad or m)."""


class MovingTransforms:
    """Transforms of the moving links. Each joint reuses one message, because the message is serialized immediately when
    it is published."""

    def __init__(self, joints: Iterable[UrdfJoint], prefix: str) -> None:
        self._joints = [joint for joint in joints if joint.kind in ("revolute", "continuous", "prismatic")]
        self._prefix = prefix
        self._names: Sequence[str] = ()
        self._messages: list[tuple[int, Mimic | None, Place, TransformStamped]] = []

    def transforms(self, names: Sequence[str], positions: Sequence[float], stamp: Time) -> list[TransformStamped]:
        """Return the transforms of the joints in ``names`` and of the joints that mimic them, omitting joints with NaN
        positions."""
        if names != self._names:
            self._names, self._messages = names, list(self._among(names))
        shown = []
        for index, mimic, place, message in self._messages:
            position = positions[index]
            if mimic is not None:
                position = position * mimic.multiplier + mimic.offset
            if position == position:  # The position is not NaN.
                place(message.transform, position)
                message.header.stamp = stamp
                shown.append(message)
        return shown

    def _among(self, names: Sequence[str]) -> Iterable[tuple[int, Mimic | None, Place, TransformStamped]]:
        at = {name: index for index, name in enumerate(names)}
        for joint in self._joints:
            # A joint's own position takes precedence over a mimicked position.
            mimic = None if joint.name in at else joint.mimic
            source = mimic.joint if mimic else joint.name
            if source in at:
                yield at[source], mimic, _place(joint), joint_transform(joint, self._prefix, Time())


def fixed_transforms(joints: Mapping[str, UrdfJoint], prefix: str, stamp: Time) -> list[TransformStamped]:
    """Return the transforms of the fixed joints."""
    return [joint_transform(joint, prefix, stamp) for joint in joints.values() if joint.kind == "fixed"]


def joint_transform(joint: UrdfJoint, prefix: str, stamp: Time) -> TransformStamped:
    """Return the transform from the parent link to the child link with the joint at position 0."""
    return transform_message(prefix + joint.parent, prefix + joint.child, *child_pose(joint, 0.0), stamp)


def _place(joint: UrdfJoint) -> Place:
    length = math.hypot(*joint.axis)
    x, y, z = (component / length for component in joint.axis)
    origin = from_rpy(joint.rpy_rad)
    if joint.kind == "prismatic":
        return _slide(joint.xyz_m, rotate(origin, (x, y, z)))
    return _turn(origin, multiply(origin, (x, y, z, 0.0)))


def _slide(start: Sequence[float], along: Sequence[float]) -> Place:
    (x, y, z), (dx, dy, dz) = start, along

    def place(transform: Transform, position_m: float) -> None:
        translation = transform.translation
        translation.x = x + dx * position_m
        translation.y = y + dy * position_m
        translation.z = z + dz * position_m

    return place


def _turn(at_rest: Sequence[float], turned: Sequence[float]) -> Place:
    """Rotate by an angle. The result is cos(angle/2) times ``at_rest`` plus sin(angle/2) times ``turned``, the
    quaternion after a rotation by 180 degrees."""
    (ax, ay, az, aw), (bx, by, bz, bw) = at_rest, turned

    def place(transform: Transform, angle_rad: float) -> None:
        c, s = math.cos(angle_rad / 2.0), math.sin(angle_rad / 2.0)
        rotation = transform.rotation
        rotation.x = ax * c + bx * s
        rotation.y = ay * c + by * s
        rotation.z = az * c + bz * s
        rotation.w = aw * c + bw * s

    return place


def transform_message(
    parent: str, child: str, position_m: Vector, quaternion: Quaternion, stamp: Time
) -> TransformStamped:
    """Convert the pose of ``child`` in ``parent``, in meters and as a unit quaternion (x, y, z, w), to a message."""
    message = TransformStamped()
    message.header.frame_id = parent
    message.header.stamp = stamp
    message.child_frame_id = child
    place, turn = message.transform.translation, message.transform.rotation
    place.x, place.y, place.z = position_m
    turn.x, turn.y, turn.z, turn.w = quaternion
    return message
