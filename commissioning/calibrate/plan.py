"""The calibration plan of an arm: for each joint which way is positive, and where its zero is found."""

from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

Zero = Literal["middle", "lower_stop", "upper_stop", "pose"]
Finite = Annotated[float, Field(allow_inf_nan=False)]


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


Drive = Annotated[float, Field(gt=0.0, le=1.0)]


class AutoPlan(BaseModel):
    """How an arm that calibrates itself keeps off its table. Positions as the URDF counts; the order counts too."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    start: dict[str, Finite] = {}
    """How the arm lies at the beginning, roughly: so that it also lies there limp."""
    clear: dict[str, Finite] = {}
    """Where joints go one by one before any of them seeks its stops. Only those whose ``start`` is known."""
    stops: dict[str, Finite] = {}
    """In this order joints seek their stops, and there each waits then. Those not named come last, and wait at 0."""
    drive: dict[str, Drive] = {}
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
