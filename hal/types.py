"""The types that the layers exchange: joints in SI units, arrays in joint order."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.bus.counters import BusCounters, ServoCounters
from drivers.bus.types import FaultKind
from drivers.servos.voltage import VoltageFault

FloatArray = NDArray[np.float64]


AT_LIMIT: Final = 1e-3
"""Within this share of its range beyond a limit a joint counts as being at it: two or three counts of 4096, and sag."""


@dataclass(frozen=True, slots=True)
class JointLimits:
    """Limits of one joint: rad and seconds, or m and seconds for a prismatic joint."""

    lower: float
    upper: float
    velocity: float
    acceleration: float
    jerk: float
    effort: float = math.inf
    """N m, or N for a prismatic joint."""
    velocity_range: tuple[float, float] | None = None
    """Lowest and highest velocity command, where the two directions differ."""
    effort_range: tuple[float, float] | None = None
    """Lowest and highest effort command, likewise."""

    def command_range(self, kind: str) -> tuple[float, float]:
        """The lowest and the highest command of this kind: position, velocity or effort."""
        if kind == "position":
            return self.lower, self.upper
        if kind == "velocity":
            return self.velocity_range or (-self.velocity, self.velocity)
        return self.effort_range or (-self.effort, self.effort)


class Stall(NamedTuple):
    """A servo that presses without motion; its drive is reduced if it has a torque limit."""

    text: str
    """For people, naming the servo."""
    warns: bool
    """Whether it is worth a warning; fingers that hold something for long are not."""


OUTSIDE_TOLERANCE: Final = 0.05
"""Share of a joint's range by which it may be outside its limits when it is activated: play, a soft stop, sag."""


def apart(value: float, limit: float) -> tuple[str, str]:
    """Format a value and its limit with as many digits, four at least, as it takes to tell them apart and from 0."""
    for digits in range(4, 16):
        said, end = f"{value:.{digits}f}", f"{limit:.{digits}f}"
        vanish = any(number and not float(text) for text, number in ((said, value), (end, limit)))
        if not vanish and said != end:
            break
    return _trimmed(said), _trimmed(end)


def _trimmed(text: str) -> str:
    """A number without the zeros behind its fourth decimal."""
    whole, _, decimals = text.partition(".")
    return f"{whole}.{decimals[:4]}{decimals[4:].rstrip('0')}"


def beyond_range(value: float, lower: float, upper: float) -> tuple[str, str, str]:
    """Format a value that is outside a range, the range's lower end and its upper end, as ``apart`` does."""
    if value < lower:
        return *apart(value, lower), f"{upper:.4f}"
    said, end = apart(value, upper)
    return said, f"{lower:.4f}", end


def far_outside(position: float, limits: JointLimits) -> str:
    """Describe a position (rad or m) that is too far outside the limits to be driven back; empty if it is not."""
    slack = OUTSIDE_TOLERANCE * (limits.upper - limits.lower)
    if limits.lower - slack <= position <= limits.upper + slack:
        return ""
    said, lower, upper = beyond_range(position, limits.lower, limits.upper)
    return f"stands at {said}, outside its limits {lower} to {upper}"


@dataclass(frozen=True, slots=True)
class ServoHealth:
    """A servo's report on itself, beside its position."""

    voltage_v: float
    temperature_c: float
    alarms: tuple[str, ...] = ()
    counters: ServoCounters | None = None
    """The counters of its faults on the wire so far."""
    load: float = math.nan
    """Drive as a share of full drive, -1 to 1, in the joint's direction."""
    current_a: float = math.nan
    """The motor's current in the joint's direction; NaN where the servo's state has none."""
    supply: VoltageFault | None = None
    """What is wrong with its voltage."""
    stall: Stall | None = None
    """Why its drive is reduced, if it is."""


class JointFault(NamedTuple):
    """A fault of a joint."""

    kind: FaultKind | Literal["implausible", "no_torque", "component"]
    """The servo's kind of fault; or its position is not believed; or it answers and may be limp; or its component is
    lost, switched or inactive."""
    text: str
    """For people, naming the joint's servo."""


@dataclass(frozen=True, slots=True)
class JointState:
    """The measurement of one cycle; arrays of shape (n,) in the hardware's joint order.

    ``position`` (rad, m), ``velocity`` (rad/s, m/s) and ``effort`` (N m, N; NaN where unknown) hold
    the last known values where ``faults`` names the joint.
    """

    stamp_s: float
    position: FloatArray
    velocity: FloatArray
    effort: FloatArray
    faults: Mapping[str, JointFault] = field(default_factory=dict)
    """Faults by joint name. Empty when all is well."""
    health: Mapping[str, ServoHealth] = field(default_factory=dict)
    """Joint name → health, where there is a servo to ask."""
    extra: Mapping[str, float] = field(default_factory=dict)
    """State interfaces beyond the three, by their full name (``joint1/acceleration``)."""
    lines: Mapping[str, BusCounters] = field(default_factory=dict)
    """Counters of its faults by serial port."""


@dataclass(frozen=True, slots=True)
class JointCommand:
    """A command for the joints in the coming period.

    ``values`` of shape (m,), in the order of the hardware's ``command_interfaces``: positions (rad, m) for the
    period's end, velocities (rad/s, m/s), efforts (N m, N).
    """

    values: FloatArray
    period_s: float
