"""Define the robot data that is needed to move a robot manually."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from drivers.driver_errors import DriverError
from hal.types import JointLimits


class HandlingError(DriverError):
    """The arm cannot be moved now."""


@dataclass(frozen=True, slots=True)
class JointsNow:
    """Current joint positions in rad or m, keyed by joint name, with their age."""

    commanded: Mapping[str, float]
    """Commanded positions. A joint without a command is listed with its measured position."""
    measured: Mapping[str, float]
    age_s: float
    faults: Mapping[str, str]
    """Fault of each faulty servo, keyed by joint name."""


class MovableRobot(Protocol):
    """Robot data that is available immediately, without a request to the stack."""

    @property
    def limits(self) -> Mapping[str, JointLimits]: ...
    def joints_now(self) -> JointsNow:
        """Return the latest positions that the stack has reported."""
        ...


def describe_faults(faults: Mapping[str, str]) -> str:
    """Describe the faults of joints. Joints with the same fault are listed together."""
    joints: dict[str, list[str]] = {}
    for joint, fault in faults.items():
        joints.setdefault(fault.removeprefix(f"{joint}: "), []).append(joint)
    return "; ".join(f"{', '.join(names)}: {fault}" for fault, names in joints.items())
