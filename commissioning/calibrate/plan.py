"""Read the calibration plan of an arm: the positive direction of each joint and how to find its zero."""

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, model_validator

from commissioning.commissioning_errors import CalibrationError
from hal.plausible import Position, TorqueLimit
from hal.yaml_nodes import compose

AUTO_PARTS: Final = ("start", "clear", "stops", "drive")
"""Parts of the automatic calibration plan that list joints."""
Zero = Literal["middle", "lower_stop", "upper_stop", "pose"]


class JointPlan(BaseModel):
    """Calibration plan of one joint. Positions are URDF joint positions, in rad (m for a prismatic joint)."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    positive: str
    """Instruction for the user that describes the positive direction of the joint."""
    zero: Zero = "middle"
    """Reference position that relates counts to URDF positions: the middle of the travel, a stop, or a marked pose.
    """
    at: Position | None = None
    """Joint position at the reference position. If this value is missing, the positions of the middle and the stops are
    derived from the URDF limits.
    """
    pose: str = ""
    """Instruction for the user that describes the pose. Used only for ``zero: pose``."""

    @model_validator(mode="after")
    def _pose_is_complete(self) -> Self:
        if self.zero == "pose" and (self.at is None or not self.pose):
            raise ValueError("`zero: pose` needs `pose` (a description of the pose) and `at` (the joint position)")
        return self

    def anchor(self, lower: float, upper: float) -> float:
        """Return the joint position at the reference ``zero`` for these limits."""
        if self.at is not None:
            return self.at
        return {"middle": 0.5 * (lower + upper), "lower_stop": lower, "upper_stop": upper, "pose": 0.0}[self.zero]


def _in_order(steps: Any) -> Any:
    """Convert a list of single-entry mappings to one mapping in the same order.

    Raises ValueError for a mapping with several entries, because the order of its entries is not reliable.
    """
    if isinstance(steps, Mapping) and len(steps) > 1:
        example = ", ".join(f"{{{name}: {position}}}" for name, position in steps.items())
        raise ValueError(
            "is a mapping, but the order matters, and other programs may reorder a mapping. Write a list instead, "
            f"such as [{example}]"
        )
    if not isinstance(steps, list):
        return steps
    if not all(isinstance(step, Mapping) and len(step) == 1 for step in steps):
        raise ValueError("must be a list with one joint per entry, such as [{elbow_flex: -0.5}]")
    found = dict[str, Any]()
    for name, position in (entry for step in steps for entry in step.items()):
        if name in found:
            raise ValueError(f"lists {name} twice")
        found[name] = position
    return found


Steps = Annotated[dict[str, Position], BeforeValidator(_in_order)]
"""Joint positions in the order in which they are reached. In a file, this is a list of single-entry mappings."""


class AutoPlan(BaseModel):
    """Plan that keeps an arm away from its table during automatic calibration. Positions are URDF joint positions."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    start: dict[str, Position] = {}
    """Approximate joint positions at the start. The arm must be able to rest in this pose with its torque disabled."""
    clear: Steps = {}
    """Positions to which joints move, one by one, before the search for stops. Each joint must have an entry in
    ``start``.
    """
    stops: Steps = {}
    """Order in which stops are searched for, and the position of each joint after its search. Other joints are searched
    last and wait at 0."""
    drive: dict[str, TorqueLimit] = {}
    """Torque limit of a joint during calibration, as a fraction of full drive; it must be just enough to lift the load.
    The default is 0.5."""

    @model_validator(mode="after")
    def _start_is_known(self) -> Self:
        if unknown := [name for name in self.clear if name not in self.start]:
            raise ValueError(f"every joint in `clear` needs a position in `start`, but {', '.join(unknown)} has none")
        return self


class ArmPlan(BaseModel):
    """Calibration plan of a whole arm, from ``arm.yaml``."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    joints: dict[str, JointPlan] = {}
    auto: AutoPlan = AutoPlan()

    def check_auto(self, joints: Collection[str], path: Path) -> None:
        """Check that ``auto`` lists only joints with servos, because ``part_of`` ignores all other names.

        Args:
            joints: Joints of the robot, on all of its buses.
            path: Path of ``arm.yaml``.

        Raises:
            CalibrationError: Some joints have no servo.
        """
        listed = [(part, name) for part in AUTO_PARTS for name in getattr(self.auto, part)]
        if unknown := [(part, name) for part, name in listed if name not in joints]:
            file = compose(path, CalibrationError)
            wrong = "; ".join(
                f"{file.place(('calibration', 'auto', part, name))}: calibration.auto.{part} lists {name}"
                for part, name in unknown
            )
            raise CalibrationError(f"{wrong}. No servo has this name: use one of {', '.join(joints)}")

    def part_of(self, joints: Collection[str]) -> "ArmPlan":
        """Return the plan for some of the joints, such as those on one bus."""
        auto = {name: _of(getattr(self.auto, name), joints) for name in AUTO_PARTS}
        return self.model_copy(update={"joints": _of(self.joints, joints), "auto": self.auto.model_copy(update=auto)})


def _of(values: Mapping[str, Any], joints: Collection[str]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if name in joints}
