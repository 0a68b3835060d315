"""How far a servo gives way under load, and how far it lags: from its model's facts and its position loop's gains.

A position loop without an integral part is a spring with a damper. Its drive grows with the error by so much a count,
and full drive is the stall torque; the damper is the motor's back-EMF, which at no-load speed takes all of the drive.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from drivers.servos import sts, x
from drivers.servos.register import ServoModel
from hal.types import FloatArray

STS_SETTINGS: Final = {"position_p": 32, "cw_dead_zone": 1, "ccw_dead_zone": 1, "max_acceleration": 100}
"""The factory's, as far as a joint's compliance hangs on them."""
STS_DRIVE_PER_COUNT: Final = 1.0 / 4000.0
"""Share of full drive a count and unit of P: the firmware's P / 4 of 1000; BAM's identification is 2 % more."""
STS_MOTOR_TIME_S: Final = 0.026
"""Rotor inertia over damping, from step responses recorded on hardware; BAM identified 0.047."""
ENCODER_STEP_COUNTS: Final = 1.0
"""Beside the dead zone, which is taken off the error, a servo leaves the count in which its encoder's steps lie."""
STS_FRICTION_SHARE: Final = 0.04
"""Share of the stall torque: twice the Coulomb friction that BAM identified (0.052 N m), as load adds to it."""

X_DRIVE_PER_COUNT: Final = 1.0 / 128.0 / x.FULL_PWM
"""By e-manual: P gain / 128 units of PWM a count."""
XL330_DRIVE_PER_COUNT: Final = X_DRIVE_PER_COUNT / 2.0
"""Half of that is what BAM saw of an XL330 on its oscilloscope."""
X_DEAD_BAND_COUNTS: Final = 2.0
"""It has no dead zone, but steps of a count in what it measures and in what it is told."""
X_FRICTION_SHARE: Final = 0.04
"""Assumed, as in the STS. The rotor's inertia is unknown too, and taken for none."""


@dataclass(frozen=True, slots=True)
class Compliance:
    """A joint's compliance, in rad and N m, or m and N for a prismatic joint."""

    stiffness: float
    """Torque or force for each unit of error."""
    lag_s: float
    """At constant speed the joint is so long behind the set-point."""
    inertia_s2: float
    """The rotor's inertia over stiffness: times the acceleration, it is so far behind."""
    profile_acceleration: float
    """A stream of goals is followed so far behind as braking takes at this: the servo means to stop at each goal."""
    dead_band: float
    """An error of so much is not corrected by the servo."""
    friction: float
    """So much torque or force may be lost at standstill."""

    @property
    def uncorrected(self) -> float:
        """The largest error at rest that dead band and friction leave, whichever side the joint came from."""
        return self.dead_band + 2.0 * self.friction / self.stiffness


def lags(compliances: Sequence[Compliance | None]) -> FloatArray:
    """Three rows, each (n,), that say how far joints lag: not at all where nothing is known.

    The first times the speed, the profile's way to brake at the second, and the third times the acceleration.
    """
    known = [
        (one.lag_s, one.profile_acceleration, one.inertia_s2) if one else (0.0, math.inf, 0.0) for one in compliances
    ]
    return np.array(known).T


def assumed_settings(model: ServoModel) -> Mapping[str, int]:
    """The settings, by register, that a servo is taken to have where nobody says otherwise."""
    return STS_SETTINGS if model in sts.MODELS.values() else {}


def compliance_of(
    model: ServoModel,
    position_p: int | None = None,
    transmission: float = 1.0,
    settings: Mapping[str, int] | None = None,
) -> Compliance | None:
    """The compliance of a joint; ``position_p`` is a Dynamixel's gain, if somebody chose one, ``settings`` an STS's.

    None where loop or gain are unknown: SCS, AX, MX and XL-320 publish no scale, and the X series' gain differs by
    model and lives in RAM.
    """
    if model in sts.MODELS.values():
        held = {**STS_SETTINGS, **(settings or {})}
        per_count = held["position_p"] * STS_DRIVE_PER_COUNT
        dead_band = max(held["cw_dead_zone"], held["ccw_dead_zone"]) + ENCODER_STEP_COUNTS
        facts = STS_MOTOR_TIME_S, _profile_counts_s2(held["max_acceleration"]), dead_band, STS_FRICTION_SHARE
    elif model in x.MODELS.values() and position_p:
        measured = model in (x.XL330_M077, x.XL330_M288)
        per_count = position_p * (XL330_DRIVE_PER_COUNT if measured else X_DRIVE_PER_COUNT)
        facts = 0.0, math.inf, X_DEAD_BAND_COUNTS, X_FRICTION_SHARE
    else:
        return None
    if not per_count:
        return None  # a servo without a position gain holds nothing
    motor_time_s, profile_counts_s2, dead_band_counts, friction_share = facts
    rad_per_count = 2.0 * math.pi / model.counts_per_turn
    stiffness = per_count / rad_per_count * model.stall_torque_nm
    lag_s = model.stall_torque_nm / model.no_load_speed_rad_s / stiffness
    return Compliance(
        stiffness=stiffness / transmission**2,
        lag_s=lag_s,
        inertia_s2=motor_time_s * lag_s,
        profile_acceleration=profile_counts_s2 * rad_per_count * transmission,
        dead_band=dead_band_counts * rad_per_count * transmission,
        friction=friction_share * model.stall_torque_nm / transmission,
    )


def _profile_counts_s2(max_acceleration: int) -> float:
    """The acceleration that each goal brings along, as far as the servo's own limit (0: none) lets it."""
    units = min(sts.GOAL_ACCELERATION, max_acceleration or sts.GOAL_ACCELERATION)
    return float(units * sts.ACCELERATION_UNIT_COUNTS_S2)
