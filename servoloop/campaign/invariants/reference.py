"""Read the files of an arm independently of the stack, so that invariants do not compare the stack with itself.

The files are read as plain YAML and XML. The files are not validated, because the stack has already validated them.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType
from typing import Any, Final
from xml.etree import ElementTree

import yaml

from drivers.servos.catalog import MODELS
from servoloop.stack.robot_files import ServoFiles

NO_JOINTS: Final = b"joints: {}"
"""Content of a calibration file that does not exist."""


@dataclass(frozen=True, slots=True)
class ReferenceJoint:
    """Joint as described in the files, in rad and rad/s, or m and m/s."""

    name: str
    bus: str
    servo_id: int
    zero_counts: int
    units_per_count: float
    """Units per count; negative if the servo turns in the opposite direction to the joint."""
    counts_per_turn: int
    lower: float
    upper: float
    velocity: float
    torque_limit: float
    """Fraction of the full torque."""
    registers: dict[str, int]
    """Values of servo registers that the robot file sets, keyed by register name."""

    def position(self, counts: int) -> float:
        """Return the joint position for a servo reading in counts."""
        return (counts - self.zero_counts) * self.units_per_count

    def readings(self, position: float, noise_counts: float) -> list[float]:
        """Return the positions that the servo may report when the joint is at a true position.

        A servo that does not count turns reports a position beyond its encoder wrap with an error of one whole turn.
        """
        counts = self.zero_counts + position / self.units_per_count
        if noise_counts <= counts < self.counts_per_turn - noise_counts:
            noise = noise_counts * self.units_per_count
            return [position - noise, position, position + noise] if noise else [position]
        near = (counts - noise_counts, counts, counts + noise_counts)
        return [
            position,
            *((near_count % self.counts_per_turn - self.zero_counts) * self.units_per_count for near_count in near),
        ]

    def turned(self, position: float) -> bool:
        """Return whether a joint with limits has been turned past the end of its encoder's range."""
        counts = self.zero_counts + position / self.units_per_count
        return math.isfinite(self.upper) and not 0.0 <= counts < self.counts_per_turn

    def apart(self, one: float, other: float) -> float:
        """Return the distance between two positions, ignoring whole turns of the servo."""
        turn = abs(self.units_per_count) * self.counts_per_turn
        return abs(math.remainder(one - other, turn))


def read_reference(
    files: ServoFiles, narrowed: Mapping[str, tuple[float, float]] = MappingProxyType({})
) -> dict[str, ReferenceJoint]:
    """Read every joint that has a servo.

    Args:
        files: Files of the arm.
        narrowed: Limits (lower, upper) that replace the limits in the files, in rad or m, keyed by joint name.

    Returns:
        The joints, keyed by joint name.
    """
    several = len(files.robot_paths) > 1
    contents = tuple(
        (block if several else "", path.read_bytes(), calibration.read_bytes() if calibration.exists() else NO_JOINTS)
        for block, path in files.robot_paths.items()
        for calibration in (path.with_name(f"{path.stem}.calibration.yaml"),)
    )
    return _joints(files.description.xml, contents, tuple(narrowed.items()))


@lru_cache(maxsize=16)
def _joints(
    urdf: str, contents: Sequence[tuple[str, bytes, bytes]], narrowed: Sequence[tuple[str, tuple[float, float]]]
) -> dict[str, ReferenceJoint]:
    """Read the joints. Several invariants read the same files in each run of a campaign.

    Args:
        urdf: Text of the URDF.
        contents: Name of each component, and contents of its robot file and its calibration file. The name is empty if
            there is only one component.
        narrowed: Joint names with the limits that replace the limits in the URDF.
    """
    limits, gears, replaced = _limits(urdf), _gears(urdf), dict(narrowed)
    joints: dict[str, ReferenceJoint] = {}
    owned = _joints_of_components(urdf)
    for component, robot_file, calibration_file in contents:
        robot, calibrated = _parsed(robot_file), _parsed(calibration_file)["joints"]
        first_bus = next(iter(robot.get("buses") or {"": None}))
        for name, entry in robot["joints"].items():
            if name in limits and name in owned.get(component, limits):
                mounted = {"bus": first_bus, **entry, **calibrated.get(name, {}), **gears.get(name, {})}
                mounted["bus"] = _bus(component, mounted["bus"])
                joints[name] = _joint(name, mounted, (*replaced.get(name, limits[name][:2]), limits[name][2]))
    return joints


def _bus(component: str, bus: str) -> str:
    """Return the name of a bus. If there are several components, it begins with the name of the component."""
    return re.sub("[^A-Za-z0-9_-]", "_", "-".join(filter(None, (component, bus))))


def _joints_of_components(urdf: str) -> dict[str, set[str]]:
    """Return the joints of each ``<ros2_control>`` block, keyed by the name of the block."""
    return {
        str(block.get("name")): {str(joint.get("name")) for joint in block.findall("joint")}
        for block in ElementTree.fromstring(urdf).iter("ros2_control")
    }


def _joint(name: str, entry: Mapping[str, Any], limits: tuple[float, float, float]) -> ReferenceJoint:
    model = MODELS[entry["model"]]
    middle = (model.last_count + 1) // 2
    unit = 2.0 * math.pi / model.counts_per_turn * entry.get("metres_per_radian", 1.0) * entry.get("sign", 1)
    unit /= entry.get("reduction", 1.0)
    middle -= round(entry.get("offset", 0.0) / unit)
    return ReferenceJoint(
        name=name,
        bus=entry["bus"],
        servo_id=entry["servo_id"],
        zero_counts=middle if entry.get("zero_counts") is None else entry["zero_counts"],
        units_per_count=unit,
        counts_per_turn=model.counts_per_turn,
        lower=limits[0],
        upper=limits[1],
        velocity=limits[2],
        torque_limit=entry.get("torque_limit", 1.0),
        registers={**entry.get("settings", {}), **_gain(entry)},
    )


def _gears(urdf: str) -> dict[str, dict[str, float]]:
    """Return the reduction and offset of each joint that has a transmission."""
    found: dict[str, dict[str, float]] = {}
    for block in ElementTree.fromstring(urdf).iter("ros2_control"):
        for joint in block.findall("transmission/joint"):
            found[str(joint.get("name"))] = {
                "reduction": float(joint.findtext("mechanical_reduction", "1")),
                "offset": float(joint.findtext("offset", "0")),
            }
    return found


def _gain(entry: Mapping[str, Any]) -> dict[str, int]:
    return {} if entry.get("position_p") is None else {"position_p": entry["position_p"]}


def _limits(urdf: str) -> dict[str, tuple[float, float, float]]:
    """Return the lower limit, upper limit and velocity limit of each joint whose limits are plain numbers."""
    found: dict[str, tuple[float, float, float]] = {}
    for joint in ElementTree.fromstring(urdf).iter("joint"):
        limit = joint.find("limit")
        if limit is None or joint.get("type") not in ("revolute", "prismatic"):
            continue
        try:
            found[str(joint.get("name"))] = (
                float(limit.get("lower", "0")),
                float(limit.get("upper", "0")),
                float(limit.get("velocity", "0")),
            )
        except ValueError:  # The limit is a xacro expression.
            continue
    return found


@lru_cache(maxsize=16)
def _parsed(content: bytes) -> Mapping[str, Any]:
    mapping: Mapping[str, Any] = yaml.safe_load(content)
    return mapping
