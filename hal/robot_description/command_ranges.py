"""Parse the ``min`` and ``max`` values of command interfaces, which narrow the limits of a joint."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final
from xml.etree.ElementTree import Element

from hal.hal_errors import DescriptionError
from hal.robot_description.urdf import UrdfJoint, finite
from hal.robot_description.xml_places import place

ENDS: Final = ("min", "max")


@dataclass(frozen=True, slots=True)
class CommandRange:
    """Range of one command interface."""

    lowest: float
    """``min``, or minus infinity if it is not set."""
    highest: float
    """``max``, or infinity if it is not set."""
    place: str
    """File and line of the interface."""


def parse_command_range(interface: str, element: Element) -> CommandRange | None:
    """Parse the range of a <command_interface>. Return None if the interface has no range. Raises DescriptionError."""
    texts: dict[str, str] = {}
    for parameter in element.findall("param"):
        name = parameter.get("name", "")
        if name in texts:
            raise DescriptionError(f"{interface} has {name} twice ({place(parameter)}): remove one.")
        if name in ENDS:
            texts[name] = (parameter.text or "").strip()
    if not texts:
        return None
    where = place(element)
    lowest, highest = (_number(interface, name, texts.get(name), where) for name in ENDS)
    found = CommandRange(-math.inf if lowest is None else lowest, math.inf if highest is None else highest, where)
    if found.lowest > found.highest:
        raise DescriptionError(f"{interface}: min {lowest} is above max {highest} ({where}): swap them.")
    if found.lowest == found.highest:
        raise DescriptionError(f"{interface}: min {lowest} equals max {highest} ({where}): widen the range.")
    return found


def _number(interface: str, name: str, text: str | None, where: str) -> float | None:
    try:
        return None if text is None else finite(text)
    except ValueError as error:
        raise DescriptionError(
            f"{interface}: {name} must be a number, not '{text}' ({where}): write a number, or remove the parameter."
        ) from error


def range_problems(joint: UrdfJoint, ranges: Mapping[str, CommandRange]) -> Iterator[str]:
    """Yield a message for each range that makes the joint unusable.

    Args:
        joint: The joint.
        ranges: Ranges, keyed by type: ``position``, ``velocity`` or ``effort``.
    """
    for kind, found in ranges.items():
        subject = f"{joint.name}/{kind}: min {found.lowest} and max {found.highest} ({found.place})"
        lower, upper = _limits(joint, kind)
        if max(lower, found.lowest) >= min(upper, found.highest):
            yield f"{subject} are outside the joint's limits {lower} to {upper}: correct them."
        elif kind == "position":
            if joint.kind == "continuous" and not (math.isfinite(found.lowest) and math.isfinite(found.highest)):
                yield (
                    f"{subject} limit only one end, but a continuous joint needs limits at both ends or none: "
                    "add the other limit."
                )
        elif not found.lowest <= 0.0 <= found.highest:
            yield f"{subject} exclude 0, so the joint could not be stopped: include 0."
        elif kind == "velocity" and "position" in joint.commands and 0.0 in (found.lowest, found.highest):
            yield f"{subject} allow only one direction, but {joint.name} also takes positions: allow both directions."


def range_warnings(joint: UrdfJoint, ranges: Mapping[str, CommandRange]) -> Iterator[str]:
    """Yield a warning for each end of a range that has no effect because the joint limit is narrower."""
    for kind, found in ranges.items():
        lower, upper = _limits(joint, kind)
        ends = (("min", found.lowest, "below", lower), ("max", found.highest, "above", upper))
        for name, end, side, limit in ends:
            if math.isfinite(end) and (end < lower or end > upper):
                yield (
                    f"{joint.name}/{kind}: {name} {end} is {side} the joint's limit {limit} ({found.place}) "
                    "and has no effect"
                )


def narrowed(joint: UrdfJoint, ranges: Mapping[str, CommandRange]) -> UrdfJoint:
    """Narrow the limits of a joint to the ranges of its commands. The ranges must have passed ``range_problems``."""
    for kind, found in ranges.items():
        lower, upper = _limits(joint, kind)
        low, high = max(lower, found.lowest), min(upper, found.highest)
        if kind == "position":
            joint = replace(joint, lower=low, upper=high)
        elif kind == "velocity":
            # A motion to a position must respect the velocity limits in both directions.
            fastest = min(-low, high) if "position" in joint.commands else max(-low, high)
            joint = replace(joint, velocity=fastest, velocity_range=(low, high))
        else:
            joint = replace(joint, effort=max(-low, high), effort_range=(low, high))
    return joint


def _limits(joint: UrdfJoint, kind: str) -> tuple[float, float]:
    if kind == "position":
        return joint.lower, joint.upper
    largest = joint.velocity if kind == "velocity" else joint.effort
    return -largest, largest
