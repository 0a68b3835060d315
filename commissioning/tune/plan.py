"""The plan of a measurement: where one joint goes, how far and how fast, before anything moves."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi, sqrt
from typing import Final

from commissioning.slow_arm import SPEED_SHARE
from commissioning.tune.errors import TuneError
from hal.joint import Joint

LIFT_RAD: Final = 0.35
"""So far a joint leaves the place where it stood, and whatever it may lie on there: more than a soft servo sags."""
STEP_RAD: Final = 0.15
"""98 counts of an STS."""
LEAST_RAD: Final = 0.03
"""With smaller steps a servo's dead band and friction are all that there is to see."""
ROOM_SHARE: Final = 0.4
"""Of the way to the limit that is further away, for either of the two."""
FASTEST_RAD_S: Final = 1.0
"""Of a servo's shaft: without a limit in the URDF that is slower."""
SINE_HZ: Final = 1.0
SPEED_MARGIN: Final = 0.8
"""Share of the speed that the gate lets through: where it holds a sine back, it is none."""


@dataclass(frozen=True, slots=True)
class Plan:
    """Where a joint goes, in rad or m: from ``start`` to ``near``, then to and fro between ``near`` and ``far``."""

    joint: str
    start: float
    near: float
    far: float
    speed: float
    """Per second; the gate lets nothing faster through."""
    sine_hz: float

    @property
    def step(self) -> float:
        """From near to far, with its sign."""
        return self.far - self.near


def plan_for(joint: Joint, start: float, at: float | None = None) -> Plan:
    """The plan for a joint that stands at ``start``: towards the limit that is further away, less where room is short.

    ``at``: where to measure, instead of a little beside the start. Raises TuneError where there is no room.
    """
    limits, unit = joint.limits, joint.transmission
    if at is not None and not limits.lower <= at <= limits.upper:
        raise TuneError(f"{joint.name} cannot go to {at:.3f}: its limits are {limits.lower:.3f} to {limits.upper:.3f}")
    begin = min(max(start if at is None else at, limits.lower), limits.upper)
    upwards = limits.upper - begin >= begin - limits.lower
    way, room = (1.0, limits.upper - begin) if upwards else (-1.0, begin - limits.lower)
    near = begin if at is not None else begin + way * min(LIFT_RAD * unit, ROOM_SHARE * room)
    step = min(STEP_RAD * unit, ROOM_SHARE * room)
    if step < LEAST_RAD * unit:
        raise TuneError(f"{joint.name} has no room to move in: its limits are {limits.lower:.3f} to {limits.upper:.3f}")
    speed = min(SPEED_SHARE * limits.velocity, FASTEST_RAD_S * unit)
    return Plan(joint.name, start, near, near + way * step, speed, _sine_hz(joint, step, speed))


def _sine_hz(joint: Joint, step: float, speed: float) -> float:
    """The frequency at which the sine (half the step to either side) stays within speed and acceleration."""
    by_speed = SPEED_MARGIN * speed / (pi * step)
    by_acceleration = sqrt(SPEED_MARGIN * joint.limits.acceleration / (0.5 * step)) / (2.0 * pi)
    return min(SINE_HZ, by_speed, by_acceleration)


def said(joint: Joint, plan: Plan, others: Sequence[str], end: str) -> str:
    """The plan for whoever is asked; ``end``: how the arm is left."""
    unit, counts = ("rad" if joint.transmission == 1.0 else "m"), abs(plan.step / joint.units_per_count)
    held = f" {', '.join(others)} will be held where they are." if others else ""
    return (
        f"{joint.name} (servo {joint.servo_id}) will move under torque: from {plan.start:.3f} to {plan.near:.3f} "
        f"{unit}, then to and fro between there and {plan.far:.3f} ({counts:.0f} counts) as steps and as a sine of "
        f"{plan.sine_hz:.2g} Hz, no faster than {plan.speed:.3g} {unit}/s (its limit is {joint.limits.velocity:g})."
        f"{held} {end} See that it has room, off its table, and hold the arm while the torque goes on if it could "
        "fall. Go on?"
    )
