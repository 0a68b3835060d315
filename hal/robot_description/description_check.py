"""What a robot description says of joints and links that cannot be true of the servos that drive them."""

import math
from collections.abc import Iterable, Iterator

from hal.joint import Joint
from hal.robot_description.description import Description, UrdfJoint

MOVING = ("revolute", "continuous", "prismatic")


def description_problems(description: Description) -> list[str]:
    """Links that weigh nothing, and joints that mimic others and cannot follow them."""
    return [*_weightless(description), *_strays(description)]


def servo_problems(joints: Iterable[Joint]) -> Iterator[str]:
    """Yields placeholders: limits that the joint's servo cannot have."""
    for joint in joints:
        fastest = joint.model.no_load_speed_rad_s * joint.transmission
        if joint.limits.velocity > fastest:
            yield (
                f"{joint.name}: velocity {joint.limits.velocity:g} in the URDF; its servo, {joint.model.name}, "
                f"makes {fastest:.3g} without load"
            )
        if not math.isfinite(joint.limits.effort):
            yield f"{joint.name}: the URDF's <limit> has no effort; its servo, {joint.model.name}, {_strength(joint)}"
        elif joint.limits.effort > 1.01 * joint.full_effort:  # data sheets are rounded
            yield (
                f"{joint.name}: effort {joint.limits.effort:g} in the URDF; its servo, {joint.model.name}, "
                f"{_strength(joint)}"
            )


def _strength(joint: Joint) -> str:
    return f"stalls at {joint.full_effort:.3g}"


def _weightless(description: Description) -> Iterator[str]:
    """Links behind a moving joint without a mass or an inertia: what moves them would meet no resistance."""
    for joint in description.joints.values():
        if joint.kind not in MOVING:
            continue
        link = description.links.get(joint.child)
        if link is None:
            yield f"{joint.name}: the URDF has no link {joint.child}"
        elif link.mass_kg <= 0.0:
            yield f"{joint.child}: its mass in the URDF is zero or missing"
        elif min(link.inertia) <= 0.0:
            yield f"{joint.child}: its inertia in the URDF is zero or missing"


def _strays(description: Description) -> Iterator[str]:
    """Mimic joints that their leader takes beyond their own limits: mostly a sign that is wrong."""
    for joint in description.joints.values():
        if joint.mimic is None:
            continue
        ends = sorted(_followed(joint, end) for end in _ends(description.joints[joint.mimic.joint]))
        if ends[0] < joint.lower - 1e-6 or ends[1] > joint.upper + 1e-6:
            yield (
                f"{joint.name} mimics {joint.mimic.joint} from {ends[0]:g} to {ends[1]:g}, and its limits are "
                f"{joint.lower:g} to {joint.upper:g}: look at the sign of the multiplier"
            )


def _ends(leader: UrdfJoint) -> tuple[float, float]:
    return leader.lower, leader.upper


def _followed(joint: UrdfJoint, leader: float) -> float:
    return joint.mimic.multiplier * leader + joint.mimic.offset + 0.0 if joint.mimic else 0.0  # + 0.0: never -0
