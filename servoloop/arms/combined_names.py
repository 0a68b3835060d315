"""Parts of a robot with several arms: each arm with its prefix, its base pose and the names that are prefixed."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, Final

from servoloop.stack.arm_folders import ArmFolder
from servoloop.stack.robot_files import Files

BASE: Final = "base_link"
"""Link on which all arms stand. This link is the root of the combined URDF and the world frame of the scene."""
NAMED: Final = ("link", "joint", "sensor", "gpio", "material", "transmission")
"""URDF elements whose names get the prefix."""


@dataclass(frozen=True, slots=True)
class BasePose:
    """Position of an arm's base on the table, in m, and its rotation about the vertical axis, in rad."""

    x_m: float
    y_m: float
    z_m: float
    """Height above the table. An arm with base pose 0 stands on the table as in its own scene."""
    yaw_rad: float


@dataclass(frozen=True, slots=True)
class Part:
    """One arm of a robot with several arms."""

    name: str
    """Name of the arm in the new robot, such as ``left``."""
    arm: ArmFolder
    files: Files
    base: BasePose

    @property
    def prefix(self) -> str:
        """Prefix of all names of this arm, such as ``left_``."""
        return f"{self.name}_"

    def names(self) -> set[str]:
        """Return the names of links, joints, other components and controllers."""
        robot = ElementTree.fromstring(self.files.description.xml)
        elements = {element.get("name", "") for tag in NAMED for element in robot.iter(tag)}
        return (elements | {spec.name for spec in self.files.controllers.controllers}) - {""}

    def prefixed(self, value: Any, names: Collection[str]) -> Any:
        """Return a YAML value with the prefix added to each of the names, including names in keys and lists.

        Interfaces such as ``joint1/position`` also get the prefix. Other values are unchanged.
        """
        if isinstance(value, str):
            return f"{self.prefix}{value}" if value.partition("/")[0] in names else value
        if isinstance(value, Mapping):
            return {self.prefixed(key, names): self.prefixed(item, names) for key, item in value.items()}
        if isinstance(value, list | tuple):
            return [self.prefixed(item, names) for item in value]
        return value
