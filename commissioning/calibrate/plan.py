"""The calibration plan of an arm: for each joint which way is positive, and where its zero is found."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, model_validator

from hal.plausible import Position, TorqueLimit

Zero = Literal["middle", "lower_stop", "upper_stop", "pose"]


class JointPlan(BaseModel):
    """How one joint is calibrated. Angles in rad (m for a prismatic joint), as the URDF counts them."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    positive: str
    """A sentence: which way the joint is to be moved for its position to grow."""
    zero: Zero = "middle"
    """Where the counts and the URDF's angles are brought together: the middle of the travel, a stop, a marked pose."""
    at: Position | None = None
    """The joint's position there; not said for the middle and the stops: what the URDF's limits say."""
    pose: str = ""
    """A sentence for ``zero: pose``: how the joint stands there."""

    @model_validator(mode="after")
    def _has_its_pose(self) -> Self:
        if self.zero == "pose" and (self.at is None or not self.pose):
            raise ValueError("zero: pose needs pose (how the joint stands) and at (its position there)")
        return self

    def anchor(self, lower: float, upper: float) -> float:
        """The joint position at the place that ``zero`` names, for a joint with these limits."""
        if self.at is not None:
            return self.at
        return {"middle": 0.5 * (lower + upper), "lower_stop": lower, "upper_stop": upper, "pose": 0.0}[self.zero]


def _in_order(steps: Any) -> Any:
    """Read a list of single entries as a mapping in this order. Raises ValueError for a mapping of several."""
    if isinstance(steps, Mapping) and len(steps) > 1:
        example = ", ".join(f"{{{name}: {position}}}" for name, position in steps.items())
        raise ValueError(
            "is a mapping, whose order another program may have changed, and its order counts: write a list in the "
            f"right order, such as [{example}]"
        )
    if not isinstance(steps, list):
        return steps
    if not all(isinstance(step, Mapping) and len(step) == 1 for step in steps):
        raise ValueError("is a list of single entries, such as [{elbow_flex: -0.5}]")
    found = dict[str, Any]()
    for name, position in (entry for step in steps for entry in step.items()):
        if name in found:
            raise ValueError(f"names {name} twice")
        found[name] = position
    return found


Steps = Annotated[dict[str, Position], BeforeValidator(_in_order)]
"""Positions by joint, one after the other: in a file a list of single entries."""


class AutoPlan(BaseModel):
    """How an arm that calibrates itself keeps off its table. Positions as the URDF counts."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    start: dict[str, Position] = {}
    """How the arm lies at the beginning, roughly: so that it also lies there limp."""
    clear: Steps = {}
    """Where joints go one by one before any of them seeks its stops. Only those whose ``start`` is known."""
    stops: Steps = {}
    """In this order joints seek their stops, and there each waits then. Those not named come last, and wait at 0."""
    drive: dict[str, TorqueLimit] = {}
    """Share of full drive: enough to lift what hangs on the joint, and no more; half unless said."""

    @model_validator(mode="after")
    def _knows_where_from(self) -> Self:
        if unknown := [name for name in self.clear if name not in self.start]:
            raise ValueError(f"clear names {', '.join(unknown)}, whose start is not said")
        return self


class ArmPlan(BaseModel):
    """The calibration of a whole arm, as ``arm.yaml`` has it."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    joints: dict[str, JointPlan] = {}
    auto: AutoPlan = AutoPlan()
