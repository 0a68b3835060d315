"""Check joint limits before hardware may drive the joints."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Final

from hal.plausible import range_mistake
from hal.robot_description.urdf import UrdfJoint

WHEEL_SPEED_RAD_S: Final = 20.0
"""Default velocity limit of a wheel for which the URDF does not set one, in rad/s."""


def with_wheel_speeds(joints: Mapping[str, UrdfJoint]) -> tuple[dict[str, UrdfJoint], tuple[str, ...]]:
    """Set a default velocity limit for wheels that have none. Return all joints and a warning for each such wheel.

    A wheel is a continuous joint that accepts only velocities or efforts. ros2_control does not limit such joints.
    """
    wheels = {
        name: joint
        for name, joint in joints.items()
        if joint.kind == "continuous" and joint.velocity == 0.0 and joint.commands and "position" not in joint.commands
    }
    warnings = tuple(
        f"{name} has no velocity limit ({joint.place}), so its limit is {WHEEL_SPEED_RAD_S:g} rad/s: to change the "
        "limit, set <limit velocity>"
        for name, joint in wheels.items()
    )
    return {**joints, **{n: replace(j, velocity=WHEEL_SPEED_RAD_S) for n, j in wheels.items()}}, warnings


def limit_problems(joints: Mapping[str, UrdfJoint]) -> Iterator[str]:
    """Yield a message for each limit that is missing or wrong. A joint that is not commanded needs no limits."""
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
            "cannot move: set its range in <limit lower upper>."
        )


def _plausibility_problems(joint: UrdfJoint) -> Iterator[str]:
    """Yield a message for each implausible limit, such as a placeholder or a number in another unit."""
    given = {"velocity": joint.velocity} if joint.velocity and joint.commands else {}
    if joint.commands and math.isfinite(joint.effort):
        given["effort"] = joint.effort
    for kind, value in given.items():
        if value > 0.0 and (mistake := range_mistake(kind, value)):
            yield f"{joint.name}: {kind} limit {mistake} ({joint.place})"
    ends = (("lower", joint.lower), ("upper", joint.upper)) if joint.commands else ()
    for key, value in ends:
        if math.isfinite(value) and (mistake := range_mistake("position", value)):
            yield f"{joint.name}: {key} limit {mistake} ({joint.place})"


def _rate_problems(joint: UrdfJoint) -> Iterator[str]:
    if joint.velocity <= 0.0:
        yield (
            f"{joint.name}: velocity limit must be above 0, not {joint.velocity} ({joint.place}): write the joint's "
            "highest speed in <limit velocity>."
        )
    # Exporters write 0 for an unknown effort limit. Without effort commands, this value has no effect.
    if joint.effort < 0.0 or (joint.effort == 0.0 and "effort" in joint.commands):
        yield (
            f"{joint.name}: effort limit must be above 0, not {joint.effort} ({joint.place}): write the highest torque "
            "or force of the joint in <limit effort>, or omit effort."
        )
