"""Plausible ranges of all numbers in the files of an arm. A boolean is not accepted as a number."""

from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, Final

from pydantic import AfterValidator, BeforeValidator, Field


@dataclass(frozen=True, slots=True)
class Range:
    """Range of plausible values, wide enough for all arms."""

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
    "rate": Range(0.0, 1000.0, "Hz"),
    "action_monitor_rate": Range(0.1, 1000.0, "Hz"),
    "time": Range(0.0, 1_000_000.0, "s"),
    "clock": Range(0.0, 1e10, "s"),
    "duration": Range(1e-6, 1_000_000.0, "s"),
    "delay": Range(1e-6, 60.0, "s"),
    "speed": Range(0.0, 10_000.0, "rad/s or m/s"),
    "any_velocity": Range(-10_000.0, 10_000.0, "rad/s or m/s"),
    "any_acceleration": Range(-100_000.0, 100_000.0, "rad/s² or m/s²"),
    "deceleration": Range(0.0, 100_000.0, "rad/s² or m/s²"),
    "tolerance": Range(0.0, 100_000.0, "rad or m"),
    "factor": Range(0.0, 1000.0, "(1 is unchanged)"),
    "torque": Range(-100.0, 100.0, "N m"),
    "stall_torque": Range(0.0, 10_000.0, "N m"),
    "counts": Range(-1_048_575, 1_048_575, "counts of the servo"),
    "backlash": Range(0.0, 10.0, "degrees"),
    "share": Range(1e-6, 1.0, "(1 is all)"),
    "voltage": Range(0.0, 60.0, "V"),
    "current": Range(0.0, 1000.0, "A"),
    "resistance": Range(0.0, 100.0, "ohm"),
    "temperature": Range(0.0, 200.0, "°C"),
    "number": Range(0, 1_000_000, "(whole)"),
    "number_of_faults": Range(0, 10_000, "in each run"),
    "seed": Range(0, 2**63 - 1, "(whole)"),
    "register_value": Range(-(2**31), 2**32 - 1, "(whole)"),
    "mass": Range(0.0, 10_000.0, "kg"),
    "inertia": Range(0.0, 1_000_000.0, "kg m²"),
    "product_of_inertia": Range(-1_000_000.0, 1_000_000.0, "kg m²"),
    "distance": Range(-1000.0, 1000.0, "m"),
    "angle": Range(-2000.0, 2000.0, "rad"),
    "axis_length": Range(1e-6, 1_000_000.0, "(1 is usual)"),
    "multiplier": Range(-100_000.0, 100_000.0, "(1 is usual)"),
    "initial_value": Range(-1_000_000.0, 1_000_000.0, "in units of the interface"),
}
"""Plausible ranges, keyed by type of number."""


def range_mistake(kind: str, value: float) -> str | None:
    """Return a message about an implausible value, worded to follow the name of the value, or None if the value is
    plausible."""
    known = RANGES[kind]
    if known.lowest <= value <= known.highest:  # false for NaN
        return None
    text = f"{value:g}" if float(f"{value:g}") == value else value
    return f"must be {known.lowest:g} to {known.highest:g} {known.unit}, not {text}"


def without_truth(value: Any) -> Any:
    """Return a value unchanged. Raises ValueError for a boolean, because pydantic would accept ``true`` as 1."""
    if isinstance(value, bool):
        raise ValueError(f"{str(value).lower()} is a boolean, but a number is required: write a number")
    return value


def _plausible(kind: str, value: Any) -> Any:
    if mistake := range_mistake(kind, value):
        raise ValueError(mistake)
    return value


def _is(kind: str) -> AfterValidator:
    return AfterValidator(partial(_plausible, kind))


NoTruth: Final = BeforeValidator(without_truth)
Finite: Final = Field(allow_inf_nan=False)
NotNegative: Final = Field(ge=0, allow_inf_nan=False)
Positive: Final = Field(gt=0, allow_inf_nan=False)
Share: Final = Field(gt=0, le=1, allow_inf_nan=False)
Position = Annotated[float, Finite, _is("position"), NoTruth]
Acceleration = Annotated[float, Positive, _is("acceleration"), NoTruth]
Jerk = Annotated[float, Positive, _is("jerk"), NoTruth]
Baud = Annotated[int, Field(gt=0), _is("baud"), NoTruth]
VelocityScale = Annotated[float, Share, _is("velocity_scale"), NoTruth]
TorqueLimit = Annotated[float, Share, _is("torque_limit"), NoTruth]
MetresPerRadian = Annotated[float, Positive, _is("metres_per_radian"), NoTruth]
UpdateRate = Annotated[int, NoTruth, _is("update_rate")]
MaxMessageSize = Annotated[int, NoTruth, _is("max_message_size")]
Rate = Annotated[float, NotNegative, _is("rate"), NoTruth]
MonitorRate = Annotated[float, Finite, _is("action_monitor_rate"), NoTruth]
Time = Annotated[float, NotNegative, _is("time"), NoTruth]
ClockTime = Annotated[float, NotNegative, _is("clock"), NoTruth]
Duration = Annotated[float, Positive, _is("duration"), NoTruth]
Delay = Annotated[float, Positive, _is("delay"), NoTruth]
Speed = Annotated[float, NotNegative, _is("speed"), NoTruth]
AnyVelocity = Annotated[float, Finite, _is("any_velocity"), NoTruth]
AnyAcceleration = Annotated[float, Finite, _is("any_acceleration"), NoTruth]
Deceleration = Annotated[float, NotNegative, _is("deceleration"), NoTruth]
Tolerance = Annotated[float, NotNegative, _is("tolerance"), NoTruth]
Effort = Annotated[float, NotNegative, _is("effort"), NoTruth]
Factor = Annotated[float, NotNegative, _is("factor"), NoTruth]
Torque = Annotated[float, Finite, _is("torque"), NoTruth]
StallTorque = Annotated[float, Positive, _is("stall_torque"), NoTruth]
Counts = Annotated[int, _is("counts"), NoTruth]
Number = Annotated[int, Field(ge=0), _is("number"), NoTruth]
FaultCount = Annotated[int, Field(ge=0), _is("number_of_faults"), NoTruth]
Backlash = Annotated[float, NotNegative, _is("backlash"), NoTruth]
Chance = Annotated[float, Share, _is("share"), NoTruth]
Volts = Annotated[float, NotNegative, _is("voltage"), NoTruth]
Amperes = Annotated[float, NotNegative, _is("current"), NoTruth]
Ohms = Annotated[float, NotNegative, _is("resistance"), NoTruth]
Celsius = Annotated[float, NotNegative, _is("temperature"), NoTruth]
Seed = Annotated[int, Field(ge=0), _is("seed"), NoTruth]
RegisterValue = Annotated[int, _is("register_value"), NoTruth]
ServoId = Annotated[int, Field(ge=0, le=253), NoTruth]
