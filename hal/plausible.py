"""The plausible range of every number in the files of an arm, in one table. A truth value is not a number."""

from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, Final

from pydantic import AfterValidator, BeforeValidator, Field


@dataclass(frozen=True, slots=True)
class Range:
    """The lowest and the highest value that some arm may have, and their unit."""

    lowest: float
    highest: float
    unit: str


RANGES: Final = {
    "position": Range(-2000.0, 2000.0, "rad or m"),
    "velocity": Range(1e-4, 10_000.0, "rad/s or m/s"),
    "effort": Range(0.0, 100_000.0, "N m or N"),
    "acceleration": Range(0.001, 100_000.0, "rad/s² or m/s²"),
    "jerk": Range(0.01, 10_000_000.0, "rad/s³ or m/s³"),
    "baud": Range(1_200, 10_000_000, "bit/s"),
    "velocity_scale": Range(0.001, 1.0, "of the velocity limit"),
    "torque_limit": Range(0.001, 1.0, "of the stall torque"),
    "metres_per_radian": Range(1e-5, 10.0, "m/rad"),
    "update_rate": Range(1, 1000, "Hz"),
    "max_message_size": Range(10_000, 1_000_000_000, "bytes"),
}
"""By kind of number."""


def range_mistake(kind: str, value: float) -> str | None:
    """Why a value cannot be of this kind, or None."""
    known = RANGES[kind]
    if known.lowest <= value <= known.highest:  # NaN is in no range
        return None
    return f"{value:g} is not a plausible {kind}: write {known.lowest:g} to {known.highest:g} {known.unit}"


def without_truth(value: Any) -> Any:
    """A value that is no truth value; pydantic would take ``true`` for 1. Raises ValueError."""
    if isinstance(value, bool):
        raise ValueError(f"{str(value).lower()} is a truth value, and a number is needed: write a number")
    return value


def _plausible(kind: str, value: Any) -> Any:
    if mistake := range_mistake(kind, value):
        raise ValueError(mistake)
    return value


NoTruth: Final = BeforeValidator(without_truth)
Finite: Final = Field(allow_inf_nan=False)
Positive: Final = Field(gt=0, allow_inf_nan=False)
Share: Final = Field(gt=0, le=1, allow_inf_nan=False)
Position = Annotated[float, Finite, AfterValidator(partial(_plausible, "position")), NoTruth]
Acceleration = Annotated[float, Positive, AfterValidator(partial(_plausible, "acceleration")), NoTruth]
Jerk = Annotated[float, Positive, AfterValidator(partial(_plausible, "jerk")), NoTruth]
Baud = Annotated[int, Field(gt=0), AfterValidator(partial(_plausible, "baud")), NoTruth]
VelocityScale = Annotated[float, Share, AfterValidator(partial(_plausible, "velocity_scale")), NoTruth]
TorqueLimit = Annotated[float, Share, AfterValidator(partial(_plausible, "torque_limit")), NoTruth]
MetresPerRadian = Annotated[float, Positive, AfterValidator(partial(_plausible, "metres_per_radian")), NoTruth]
UpdateRate = Annotated[int, NoTruth, AfterValidator(partial(_plausible, "update_rate"))]
MaxMessageSize = Annotated[int, NoTruth, AfterValidator(partial(_plausible, "max_message_size"))]
