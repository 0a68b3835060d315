"""A second, simple reader of an arm's files: what invariants compare the stack with must not come from the stack.

It reads the files as plain YAML and XML. It knows nothing of mistakes: the stack's own reader has refused those.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import yaml

from drivers.servos.catalog import MODELS
from servoloop.stack.robot_files import ServoFiles


@dataclass(frozen=True, slots=True)
class ReferenceJoint:
    """One joint as its files describe it: rad and rad/s, or m and m/s."""

    name: str
    bus: str
    servo_id: int
    zero_counts: int
    units_per_count: float
    """With the sign."""
    counts_per_turn: int
    lower: float
    upper: float
    velocity: float
    torque_limit: float
    """Share of full drive."""
    registers: dict[str, int]
    """Registers of the servo that the robot file gives values to."""

    def position(self, counts: int) -> float:
        """The joint's position at a servo's reading."""
        return (counts - self.zero_counts) * self.units_per_count

    def apart(self, one: float, other: float) -> float:
        """The distance of two positions; a servo that reports its place within a turn may be whole turns off."""
        turn = abs(self.units_per_count) * self.counts_per_turn
        return abs(math.remainder(one - other, turn))


def read_reference(files: ServoFiles) -> dict[str, ReferenceJoint]:
    """Read every joint that has a servo, by name."""
    limits = _limits(files.urdf_path)
    joints: dict[str, ReferenceJoint] = {}
    for path in dict.fromkeys(files.robot_paths.values()):
        robot = _yaml(path)
        calibration = path.with_name(f"{path.stem}.calibration.yaml")
        calibrated = _yaml(calibration)["joints"] if calibration.exists() else {}
        first_bus = next(iter(robot.get("buses") or {"": None}))
        for name, entry in robot["joints"].items():
            if name in limits:
                mounted = {"bus": first_bus, **entry, **calibrated.get(name, {})}
                joints[name] = _joint(name, mounted, limits[name])
    return joints


def _joint(name: str, entry: dict[str, Any], limits: tuple[float, float, float]) -> ReferenceJoint:
    model = MODELS[entry["model"]]
    middle = (model.last_count + 1) // 2
    unit = 2.0 * math.pi / model.counts_per_turn * entry.get("metres_per_radian", 1.0) * entry.get("sign", 1)
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


def _gain(entry: dict[str, Any]) -> dict[str, int]:
    return {} if entry.get("position_p") is None else {"position_p": entry["position_p"]}


def _limits(urdf: Path) -> dict[str, tuple[float, float, float]]:
    """Lower, upper and velocity limit of each joint whose limits are plain numbers."""
    found: dict[str, tuple[float, float, float]] = {}
    for joint in ElementTree.parse(urdf).getroot().iter("joint"):
        limit = joint.find("limit")
        if limit is None or joint.get("type") not in ("revolute", "prismatic"):
            continue
        try:
            found[str(joint.get("name"))] = (
                float(limit.get("lower", "0")),
                float(limit.get("upper", "0")),
                float(limit.get("velocity", "0")),
            )
        except ValueError:  # an expression of xacro
            continue
    return found


def _yaml(path: Path) -> dict[str, Any]:
    content: dict[str, Any] = yaml.safe_load(path.read_bytes())
    return content
