"""What is known of a robot that is to be moved. No ROS."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from drivers.errors import DriverError
from hal.types import JointLimits


class HandlingError(DriverError):
    """The arm cannot be moved now."""


@dataclass(frozen=True, slots=True)
class JointsNow:
    """The joints as they are: rad or m by joint name, and how old that is."""

    commanded: Mapping[str, float]
    """Where they are not commanded, as measured."""
    measured: Mapping[str, float]
    age_s: float
    faults: Mapping[str, str]
    """What is wrong with a joint's servo."""


class Robot(Protocol):
    """What is known of the robot without asking it."""

    @property
    def limits(self) -> Mapping[str, JointLimits]: ...
    def joints_now(self) -> JointsNow:
        """The joints as the stack has told last."""
        ...


def in_words(faults: Mapping[str, str]) -> str:
    """Faults by joint in words; what is the same with several is said once."""
    joints: dict[str, list[str]] = {}
    for joint, fault in faults.items():
        joints.setdefault(fault.removeprefix(f"{joint}: "), []).append(joint)
    return "; ".join(f"{', '.join(names)}: {fault}" for fault, names in joints.items())
