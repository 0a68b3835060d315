"""What the layers say to each other: joints in SI units, arrays in joint order."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from drivers.counters import ServoCounters

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class JointLimits:
    """Limits of one joint: rad and seconds, or m and seconds for a prismatic joint."""

    lower: float
    upper: float
    velocity: float
    acceleration: float
    jerk: float


@dataclass(frozen=True, slots=True)
class ServoHealth:
    """What a servo says of itself beside its position."""

    voltage_v: float
    temperature_c: float
    alarms: tuple[str, ...] = ()
    counters: ServoCounters | None = None
    """What went wrong with it on the wire so far: the bus's own account, which goes on counting."""


@dataclass(frozen=True, slots=True)
class JointState:
    """What was measured in one cycle; arrays of shape (n,) in the hardware's joint order.

    ``position`` (rad, m), ``velocity`` (rad/s, m/s) and ``effort`` (N m, N; NaN where unknown) hold
    the last known values where ``faults`` names the joint.
    """

    stamp_s: float
    position: FloatArray
    velocity: FloatArray
    effort: FloatArray
    faults: Mapping[str, str] = field(default_factory=dict)
    """Joint name → what is wrong with it, naming the servo. Empty when all is well."""
    health: Mapping[str, ServoHealth] = field(default_factory=dict)
    """Joint name → health, where there is a servo to ask."""


@dataclass(frozen=True, slots=True)
class JointCommand:
    """Where the joints shall be one period from now: ``position`` of shape (n,), rad or m."""

    position: FloatArray
    period_s: float
