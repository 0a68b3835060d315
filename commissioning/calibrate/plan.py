"""The calibration plan of an arm: for each joint which way is positive, and where its zero is found."""

from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

Zero = Literal["middle", "lower_stop", "upper_stop", "pose"]
Finite = Annotated[float, Field(allow_inf_nan=False)]


class AutoPlan(BaseModel):
    """How one joint is driven where the arm calibrates itself."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    order: int = 0
    """Joints with smaller numbers go first; among equals the first in the robot file."""
    drive: Annotated[float, Field(gt=0.0, le=1.0)] = 0.5
    """Share of full drive: enough to lift what hangs on the joint, and no more."""
    rest: Finite = 0.0
    """Where the joint waits for the others behind it, as the URDF counts."""


class JointPlan(BaseModel):
    """How one joint is calibrated. Angles in rad (m for a prismatic joint), as the URDF counts them."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    positive: str
    """A sentence: which way the joint is to be moved for its position to grow."""
    zero: Zero = "middle"
    """Where the counts and the URDF's angles are brought together: the middle of the travel, a stop, a marked pose."""
    at: Finite | None = None
    """The joint's position there; not said for the middle and the stops: what the URDF's limits say."""
    pose: str = ""
    """A sentence for ``zero: pose``: how the joint stands there."""
    auto: AutoPlan = AutoPlan()

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
