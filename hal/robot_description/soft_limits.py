"""Parse the soft limits in ``<safety_controller>``, which narrow the position range of a joint."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final
from xml.etree.ElementTree import Element

from hal.robot_description.urdf import UrdfJoint, number
from hal.robot_description.xml_places import place

LOWER: Final = "soft_lower_limit"
UPPER: Final = "soft_upper_limit"


@dataclass(frozen=True, slots=True)
class SoftLimits:
    """Soft limits of one joint, in rad or m."""

    lower: float
    upper: float
    place: str
    """File and line of the <safety_controller>."""


def parse_soft_limits(robot: Element) -> dict[str, SoftLimits]:
    """Return the soft limits of a ``<robot>``, keyed by joint name. A missing limit is 0, as in a URDF.

    Raises:
        DescriptionError: A limit is not a number.
    """
    found: dict[str, SoftLimits] = {}
    for joint in robot.findall("joint"):
        safety, name = joint.find("safety_controller"), joint.get("name", "")
        if safety is not None and (LOWER in safety.attrib or UPPER in safety.attrib):
            lower, upper = (number(safety, key, name, 0.0, "position") for key in (LOWER, UPPER))
            found[name] = SoftLimits(lower, upper, place(safety))
    return found


def soft_limit_problems(joint: UrdfJoint, soft: SoftLimits) -> Iterator[str]:
    """Yield a message for soft limits that make the joint unusable."""
    subject = f"{joint.name}: {LOWER} {soft.lower}"
    if soft.lower > soft.upper:
        yield f"{subject} is above {UPPER} {soft.upper} ({soft.place}): swap them."
    elif soft.lower < soft.upper and max(soft.lower, joint.lower) >= min(soft.upper, joint.upper):
        limits = f"the joint's limits {joint.lower} to {joint.upper}"
        yield f"{subject} and {UPPER} {soft.upper} ({soft.place}) are outside {limits}: correct them."


def soft_limit_warnings(joint: UrdfJoint, soft: SoftLimits) -> Iterator[str]:
    """Yield a warning for each soft limit that has no effect."""
    if soft.lower == soft.upper:
        yield f"{joint.name}: {LOWER} and {UPPER} are both {soft.lower} ({soft.place}) and have no effect"
        return
    ends = ((LOWER, soft.lower, "below", joint.lower), (UPPER, soft.upper, "above", joint.upper))
    for name, end, side, limit in ends:
        if end < joint.lower or end > joint.upper:
            yield f"{joint.name}: {name} {end} is {side} the joint's limit {limit} ({soft.place}) and has no effect"


def softened(joint: UrdfJoint, soft: SoftLimits) -> UrdfJoint:
    """Narrow the limits of a joint to its soft limits, which must have passed ``soft_limit_problems``."""
    if soft.lower == soft.upper:
        return joint
    lower, upper = max(joint.lower, soft.lower), min(joint.upper, soft.upper)
    return replace(joint, lower=lower, upper=upper, stops=joint.stops or (joint.lower, joint.upper))
