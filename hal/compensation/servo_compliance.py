"""Compute the stiffness and lag of a servo from its model data and the gains of its position loop.

A position loop without an integral term acts like a spring with a damper. The drive is proportional to the error, and
full drive corresponds to the stall torque. The damper is the back-EMF of the motor, which balances full drive at
no-load speed.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from drivers.servos import sts, x
from drivers.servos.ram_gains import ram_gains
from drivers.servos.register import ServoModel
from hal.types import FloatArray

STS_SETTINGS: Final = {"position_p": 32, "cw_dead_zone": 1, "ccw_dead_zone": 1, "max_acceleration": 100}
"""Factory settings that affect the compliance."""
STS_DRIVE_PER_COUNT: Final = 1.0 / 4000.0
"""Fraction of full drive per count of error and per unit of P. In the firmware, full drive is 1000 and each count of
error adds P / 4. The value that BAM identified is 2 % higher.
"""
STS_MOTOR_TIME_S: Final = 0.026
"""Rotor inertia divided by damping, from step responses recorded on hardware. BAM identified 0.047."""
ENCODER_STEP_COUNTS: Final = 1.0
"""Resolution of the encoder. A servo does not correct errors below its dead zone plus this resolution."""
STS_FRICTION_SHARE: Final = 0.04
"""Friction as a fraction of the stall torque: twice the Coulomb friction that BAM identified (0.052 N m), because load
increases friction.
"""

X_DRIVE_PER_COUNT: Final = 1.0 / 128.0 / x.FULL_PWM
"""Fraction of full drive per count of error and unit of P. According to the e-manual, the drive is P / 128 PWM units
per count of error.
"""
XL330_DRIVE_PER_COUNT: Final = X_DRIVE_PER_COUNT / 2.0
"""Half of ``X_DRIVE_PER_COUNT``. BAM measured this value on an XL330 with an oscilloscope."""
X_DEAD_BAND_COUNTS: Final = 2.0
"""Dead band of the X series, which has no dead zone: one count each for the resolution of the measurement and of the
goal."""
X_FRICTION_SHARE: Final = 0.04
"""Friction as a fraction of the stall torque. The value for the STS is assumed. The unknown rotor inertia is assumed to
be zero.
"""


@dataclass(frozen=True, slots=True)
class Compliance:
    """Compliance of a joint, in rad and N m, or in m and N for a prismatic joint."""

    stiffness: float
    """Torque or force per unit of error."""
    lag_s: float
    """Delay of the joint relative to the set-point at constant speed, in seconds."""
    inertia_s2: float
    """Rotor inertia divided by stiffness. This value times the acceleration is the lag due to inertia."""
    profile_acceleration: float
    """Deceleration at which the servo stops at each goal. If goals arrive continuously, the servo lags by its braking
    distance.
    """
    dead_band: float
    """Error below which the servo makes no correction."""
    friction: float
    """Torque or force that may be lost to friction at standstill."""

    @property
    def uncorrected(self) -> float:
        """Largest error at rest due to dead band and friction, when approached from either side."""
        return self.dead_band + 2.0 * self.friction / self.stiffness


def lags(compliances: Sequence[Compliance | None]) -> FloatArray:
    """Return the lag coefficients of joints. Joints with unknown compliance have no lag.

    Returns:
        Array of shape (3, n): the delay (multiplied by speed), the profile acceleration (for the braking distance), and
        the inertia (multiplied by acceleration).
    """
    known = [
        (one.lag_s, one.profile_acceleration, one.inertia_s2) if one else (0.0, math.inf, 0.0) for one in compliances
    ]
    return np.array(known).T


def assumed_settings(model: ServoModel) -> Mapping[str, int]:
    """Return the settings that a servo is assumed to have, keyed by register name."""
    return STS_SETTINGS if model in sts.MODELS.values() else {}


def compliance_of(
    model: ServoModel,
    position_p: int | None = None,
    transmission: float = 1.0,
    settings: Mapping[str, int] | None = None,
) -> Compliance | None:
    """Compute the compliance of a joint.

    Args:
        model: Model of the servo.
        position_p: Position P gain of a Dynamixel. By default, this is the factory gain, which activation writes.
        transmission: Joint units per radian of the shaft.
        settings: Settings that differ from the factory settings, keyed by register name.

    Returns:
        The compliance, or None if it is unknown. The gain scale of SCS, AX, MX and XL-320 servos is not published. The
        error at rest of an X servo with an I gain does not show its load. The factory gains of an XL330-M077 include an
        I gain.
    """
    factory = ram_gains(model)
    position_i = (settings or {}).get(x.position_i_gain.name, factory.get(x.position_i_gain))
    if position_p is None and not position_i:
        position_p = factory.get(x.position_p_gain)
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
        return None  # a servo whose position gain is zero does not hold
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
    """Return the acceleration of each goal, limited by the servo's own maximum (0 means no limit)."""
    units = min(sts.GOAL_ACCELERATION, max_acceleration or sts.GOAL_ACCELERATION)
    return float(units * sts.ACCELERATION_UNIT_COUNTS_S2)
