"""Find limits in a robot description that the servos cannot reach, and links without mass."""

import math
from collections.abc import Iterable, Iterator

from hal.joint import Joint
from hal.robot_description.description import Description, UrdfJoint

MOVING = ("revolute", "continuous", "prismatic")


def description_problems(description: Description) -> list[str]:
    """List links without mass or inertia, and mimic joints that would move beyond their limits."""
    return [*_massless(description), *_beyond_limits(description)]


def servo_problems(joints: Iterable[Joint]) -> Iterator[str]:
    """Yield a message for each limit that the joint's servo cannot reach, such as a placeholder value."""
    for joint in joints:
        fastest = joint.model.no_load_speed_rad_s * joint.transmission
        if joint.limits.velocity > fastest:
            yield (
                f"{joint.name}: the velocity limit in the URDF is {joint.limits.velocity:g}, but its servo, "
                f"{joint.model.name}, reaches only {fastest:.3g} without load"
            )
        if not math.isfinite(joint.limits.effort):
            yield (
                f"{joint.name}: its <limit> in the URDF has no effort, but its servo, "
                f"{joint.model.name}, {_strength(joint)}"
            )
        elif joint.limits.effort > 1.01 * joint.full_effort:  # datasheet values are rounded
            yield (
                f"{joint.name}: the effort limit in the URDF is {joint.limits.effort:g}, but its servo, "
                f"{joint.model.name}, {_strength(joint)}"
            )


def _strength(joint: Joint) -> str:
    return f"stalls at {joint.full_effort:.3g}"


def _massless(description: Description) -> Iterator[str]:
    """Yield a message for each child link of a moving joint that has no mass or no inertia."""
    for joint in description.joints.values():
        if joint.kind not in MOVING:
            continue
        link = description.links.get(joint.child)
        if link is None:
            yield f"{joint.name}: its child link {joint.child} is not in the URDF"
        elif link.mass_kg <= 0.0:
            yield f"{joint.child}: its mass in the URDF is zero or missing"
        elif min(link.inertia) <= 0.0:
            yield f"{joint.child}: its inertia in the URDF is zero or missing"


def _beyond_limits(description: Description) -> Iterator[str]:
    """Yield a message for each mimic joint that would move beyond its limits. The usual cause is a wrong sign."""
    for joint in description.joints.values():
        if joint.mimic is None:
            continue
        ends = sorted(_followed(joint, end) for end in _ends(description.joints[joint.mimic.joint]))
        if ends[0] < joint.lower - 1e-6 or ends[1] > joint.upper + 1e-6:
            yield (
                f"{joint.name} mimics {joint.mimic.joint} and would move from {ends[0]:g} to {ends[1]:g}, but its "
                f"limits are {joint.lower:g} to {joint.upper:g}: check the sign of the multiplier"
            )


def _ends(leader: UrdfJoint) -> tuple[float, float]:
    return leader.lower, leader.upper


def _followed(joint: UrdfJoint, leader: float) -> float:
    return joint.mimic.multiplier * leader + joint.mimic.offset + 0.0 if joint.mimic else 0.0  # + 0.0 avoids -0
