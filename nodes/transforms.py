"""The transforms of a robot's links: all that does not change is worked out once, a cycle fills in the rest."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Transform, TransformStamped

from hal.robot_description.description import Mimic, UrdfJoint, Vector
from hal.robot_description.kinematics import Quaternion, child_pose, from_rpy, multiply, rotate

Place = Callable[[Transform, float], None]
"""Fills in what changes with the joint's position (rad or m)."""


class MovingTransforms:
    """The moving links. One message a joint serves all cycles: publishing writes it out at once."""

    def __init__(self, joints: Iterable[UrdfJoint], prefix: str) -> None:
        self._joints = [joint for joint in joints if joint.kind in ("revolute", "continuous", "prismatic")]
        self._prefix = prefix
        self._names: Sequence[str] = ()
        self._messages: list[tuple[int, Mimic | None, Place, TransformStamped]] = []

    def transforms(self, names: Sequence[str], positions: Sequence[float], stamp: Time) -> list[TransformStamped]:
        """The transforms of all joints that are among ``names`` or follow one of them, but for positions of NaN."""
        if names is not self._names:
            self._names, self._messages = names, list(self._among(names))
        shown = []
        for index, mimic, place, message in self._messages:
            position = positions[index]
            if mimic is not None:
                position = position * mimic.multiplier + mimic.offset
            if position == position:  # not NaN
                place(message.transform, position)
                message.header.stamp = stamp
                shown.append(message)
        return shown

    def _among(self, names: Sequence[str]) -> Iterable[tuple[int, Mimic | None, Place, TransformStamped]]:
        at = {name: index for index, name in enumerate(names)}
        for joint in self._joints:
            mimic = None if joint.name in at else joint.mimic  # what is said of a joint itself counts
            source = mimic.joint if mimic else joint.name
            if source in at:
                yield at[source], mimic, _place(joint), joint_transform(joint, self._prefix, Time())


def fixed_transforms(joints: Mapping[str, UrdfJoint], prefix: str, stamp: Time) -> list[TransformStamped]:
    """The transforms of the joints that never move."""
    return [joint_transform(joint, prefix, stamp) for joint in joints.values() if joint.kind == "fixed"]


def joint_transform(joint: UrdfJoint, prefix: str, stamp: Time) -> TransformStamped:
    """The child link in its parent, the joint at 0."""
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


def _turn(still: Sequence[float], turned: Sequence[float]) -> Place:
    """A turn by an angle is cos(half) of the one quaternion and sin(half) of the other."""
    (ax, ay, az, aw), (bx, by, bz, bw) = still, turned

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
    """The pose of ``child`` in ``parent``: metres and a unit quaternion (x, y, z, w)."""
    message = TransformStamped()
    message.header.frame_id = parent
    message.header.stamp = stamp
    message.child_frame_id = child
    place, turn = message.transform.translation, message.transform.rotation
    place.x, place.y, place.z = position_m
    turn.x, turn.y, turn.z, turn.w = quaternion
    return message
