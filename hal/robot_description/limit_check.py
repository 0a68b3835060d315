"""The limits that a joint needs before any hardware may drive it."""

import math
from collections.abc import Iterator, Mapping

from hal.plausible import range_mistake
from hal.robot_description.urdf import UrdfJoint


def limit_problems(joints: Mapping[str, UrdfJoint]) -> Iterator[str]:
    """Yields each limit that cannot be kept. A joint that takes no commands needs none."""
    for joint in joints.values():
        yield from _range_problems(joint)
        yield from _plausibility_problems(joint)
        if joint.commands:
            yield from _rate_problems(joint)


def _range_problems(joint: UrdfJoint) -> Iterator[str]:
    if joint.lower > joint.upper:
        yield (
            f"{joint.name}: lower limit {joint.lower} is above upper limit {joint.upper} ({joint.place}): swap them."
        )
    elif joint.lower == joint.upper and joint.commands:
        yield (
            f"{joint.name}: lower limit {joint.lower} equals upper limit {joint.upper} ({joint.place}), so the joint "
            "cannot move: give its range in <limit lower upper>."
        )


def _plausibility_problems(joint: UrdfJoint) -> Iterator[str]:
    """Yields limits that no arm has: a placeholder, or a number in another unit."""
    said = {"velocity": joint.velocity} if joint.velocity else {}
    if math.isfinite(joint.effort):
        said["effort"] = joint.effort
    for kind, value in said.items():
        if (value > 0.0 or not joint.commands) and (mistake := range_mistake(kind, value)):
            yield f"{joint.name}: {kind} limit {mistake} ({joint.place})"
    for key, value in (("lower", joint.lower), ("upper", joint.upper)):
        if math.isfinite(value) and (mistake := range_mistake("position", value)):
            yield f"{joint.name}: {key} limit {mistake} ({joint.place})"


def _rate_problems(joint: UrdfJoint) -> Iterator[str]:
    if joint.velocity <= 0.0:
        yield (
            f"{joint.name}: velocity limit {joint.velocity} is not above zero ({joint.place}): give the joint's "
            "highest speed in <limit velocity>."
        )
    # Exporters write 0 for an effort that is unknown; without effort commands no limit follows from it.
    if joint.effort < 0.0 or (joint.effort == 0.0 and "effort" in joint.commands):
        yield (
            f"{joint.name}: effort limit {joint.effort} is not above zero ({joint.place}): give the joint's largest "
            "torque or force in <limit effort>, or leave effort out."
        )
