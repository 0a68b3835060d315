"""Define the types that the layers exchange: joints in SI units, arrays in joint order."""

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
"""Share of its range by which a joint may be beyond a limit and still count as being at it: two or three counts of
4096, and sag."""


@dataclass(frozen=True, slots=True)
class JointLimits:
    """Limits of one joint, in rad and seconds; in m and seconds for a prismatic joint."""

    lower: float
    """Lowest position, in rad or m."""
    upper: float
    """Highest position, in rad or m."""
    velocity: float
    """Maximum velocity, in rad/s or m/s."""
    acceleration: float
    """Maximum acceleration, in rad/s² or m/s²."""
    jerk: float
    """Maximum jerk, in rad/s³ or m/s³."""
    effort: float = math.inf
    """Maximum effort, in N m; in N for a prismatic joint."""
    velocity_range: tuple[float, float] | None = None
    """Lowest and highest velocity command, if the two directions differ."""
    effort_range: tuple[float, float] | None = None
    """Lowest and highest effort command, if the two directions differ."""

    def command_range(self, kind: str) -> tuple[float, float]:
        """Return the range of one kind of command.

        Args:
            kind: "position", "velocity" or "effort".

        Returns:
            The lowest and the highest command, in rad, rad/s or N m (m, m/s or N for a prismatic joint).
        """
        if kind == "position":
            return self.lower, self.upper
        if kind == "velocity":
            return self.velocity_range or (-self.velocity, self.velocity)
        return self.effort_range or (-self.effort, self.effort)


class Stall(NamedTuple):
    """Servo that presses without moving. Its drive is reduced if it has a torque limit."""

    text: str
    """Message that names the servo."""
    warns: bool
    """Whether to log a warning. There is none for fingers that hold an object for a long time."""


OUTSIDE_TOLERANCE: Final = 0.05
"""Share of its range by which a joint may be outside its limits at activation, because of play, a soft stop or sag."""


def apart(value: float, limit: float) -> tuple[str, str]:
    """Format a value and its limit with enough digits, at least four, to distinguish both from each other and 0."""
    for digits in range(4, 16):
        said, end = f"{value:.{digits}f}", f"{limit:.{digits}f}"
        vanish = any(number and not float(text) for text, number in ((said, value), (end, limit)))
        if not vanish and said != end:
            break
    return _trimmed(said), _trimmed(end)


def _trimmed(text: str) -> str:
    """Remove the zeros after the fourth decimal of a number."""
    whole, _, decimals = text.partition(".")
    return f"{whole}.{decimals[:4]}{decimals[4:].rstrip('0')}"


def beyond_range(value: float, lower: float, upper: float) -> tuple[str, str, str]:
    """Format a value that is outside a range, and the lower and the upper end of the range, as ``apart`` does."""
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
    """Condition that a servo reports, in addition to its position."""

    voltage_v: float
    """Supply voltage, in V."""
    temperature_c: float
    """Temperature, in °C."""
    alarms: tuple[str, ...] = ()
    """Names of the alarms that the servo reports."""
    counters: ServoCounters | None = None
    """Numbers of its faults on the bus so far."""
    load: float = math.nan
    """Drive as a share of full drive, -1 to 1, in the joint's direction."""
    current_a: float = math.nan
    """Motor current in the joint's direction, in A; NaN if the servo's state has none."""
    supply: VoltageFault | None = None
    """Fault of its supply voltage; None if the voltage is right."""
    stall: Stall | None = None
    """Reason why its drive is reduced; None if it is not."""


class JointFault(NamedTuple):
    """Fault of a joint."""

    kind: FaultKind | Literal["implausible", "no_torque", "component"]
    """Kind of the servo's fault. Other kinds: "implausible" (the position is not accepted), "no_torque" (the servo
    answers and may be limp), "component" (its component is lost, switched or inactive)."""
    text: str
    """Message that names the servo of the joint."""


@dataclass(frozen=True, slots=True)
class JointState:
    """Measurement of one cycle. Arrays have shape (n,), in the hardware's joint order. A joint named in ``faults``
    keeps its last known values.
    """

    stamp_s: float
    """Time of the measurement, in seconds on the stack's clock."""
    position: FloatArray
    """Positions, in rad or m."""
    velocity: FloatArray
    """Velocities, in rad/s or m/s."""
    effort: FloatArray
    """Efforts, in N m or N; NaN if unknown."""
    faults: Mapping[str, JointFault] = field(default_factory=dict)
    """Fault by joint name; empty if all joints were measured."""
    health: Mapping[str, ServoHealth] = field(default_factory=dict)
    """Condition of the servo by joint name; empty for joints without a servo."""
    extra: Mapping[str, float] = field(default_factory=dict)
    """Values of further state interfaces by full name, such as ``joint1/acceleration``."""
    lines: Mapping[str, BusCounters] = field(default_factory=dict)
    """Fault counters by serial port."""


@dataclass(frozen=True, slots=True)
class JointCommand:
    """Command for the joints in the coming period."""

    values: FloatArray
    """Values of shape (m,), in the order of the hardware's ``command_interfaces``: positions at the end of the
    period (rad, m), velocities (rad/s, m/s) or efforts (N m, N)."""
    period_s: float
    """Duration of the period, in seconds."""
