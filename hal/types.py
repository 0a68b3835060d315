"""Types that the layers exchange. Values are in SI units, and arrays are in joint order."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.bus.counters import BusCounters, ServoCounters
from drivers.servos.voltage import VoltageFault
from drivers.types import FaultKind

FloatArray = NDArray[np.float64]


AT_LIMIT: Final = 1e-3
"""Maximum distance beyond a limit at which a joint counts as being at the limit, as a fraction of its range. This
distance covers sag and two or three counts of 4096.
"""


class Interface(NamedTuple):
    """A state or command interface of a joint. ros2_control writes its name as ``joint/kind``."""

    joint: str
    """Name of the joint."""
    kind: str
    """``position``, ``velocity``, ``effort`` or the name of another quantity."""

    @classmethod
    def parse(cls, name: str) -> "Interface":
        """Parse the name of an interface, such as ``joint1/position``."""
        joint, _, kind = name.rpartition("/")
        return cls(joint, kind)

    def __str__(self) -> str:
        return f"{self.joint}/{self.kind}"


def joints_of(interfaces: Iterable[str]) -> list[str]:
    """Return the joint of each interface, in the order of the interfaces."""
    return [Interface.parse(name).joint for name in interfaces]


def position_interfaces(joints: Iterable[str]) -> tuple[str, ...]:
    """Return the name of each joint's position interface."""
    return tuple(str(Interface(joint, "position")) for joint in joints)


@dataclass(frozen=True, slots=True)
class JointLimits:
    """Limits of one joint. Units are rad and s for a revolute joint, and m and s for a prismatic joint."""

    lower: float
    """Lowest position, in rad or m."""
    upper: float
    """Highest position, in rad or m."""
    velocity: float
    """Maximum speed, in rad/s or m/s."""
    acceleration: float
    """Maximum acceleration, in rad/s² or m/s²."""
    jerk: float
    """Maximum jerk, in rad/s³ or m/s³."""
    effort: float = math.inf
    """Maximum torque in N m, or maximum force in N."""
    velocity_range: tuple[float, float] | None = None
    """Lowest and highest velocity command, if the two directions differ."""
    effort_range: tuple[float, float] | None = None
    """Lowest and highest effort command, if the two directions differ."""

    def command_range(self, kind: str) -> tuple[float, float]:
        """Return the range of one type of command.

        Args:
            kind: "position", "velocity" or "effort".

        Returns:
            The lowest and highest commands, in rad, rad/s or N m (m, m/s or N for a prismatic joint).
        """
        if kind == "position":
            return self.lower, self.upper
        if kind == "velocity":
            return self.velocity_range or (-self.velocity, self.velocity)
        return self.effort_range or (-self.effort, self.effort)


class Stall(NamedTuple):
    """Report on a servo that pushes without moving. If the joint has a torque limit, the drive is reduced."""

    text: str
    """Description that includes the servo's ID."""
    warns: bool
    """Whether to show a warning. It is normal for a gripper to hold an object for some time, so this causes no
    warning."""


OUTSIDE_TOLERANCE: Final = 0.05
"""Maximum distance that a joint may be outside its limits at activation, as a fraction of its range. This distance
covers backlash, soft end stops and sag.
"""


def apart(value: float, limit: float) -> tuple[str, str]:
    """Format a value and its limit with at least four decimals, and with more if the two would otherwise look equal or
    like 0."""
    for digits in range(4, 16):
        shown, end = f"{value:.{digits}f}", f"{limit:.{digits}f}"
        vanish = any(number and not float(text) for text, number in ((shown, value), (end, limit)))
        if not vanish and shown != end:
            break
    return _trimmed(shown), _trimmed(end)


def _trimmed(text: str) -> str:
    """Remove trailing zeros after the fourth decimal."""
    whole, _, decimals = text.partition(".")
    return f"{whole}.{decimals[:4]}{decimals[4:].rstrip('0')}"


def beyond_range(value: float, lower: float, upper: float) -> tuple[str, str, str]:
    """Format a value outside a range, and both ends of the range. The value and the end that it exceeds are formatted
    with ``apart``."""
    if value < lower:
        return *apart(value, lower), f"{upper:.4f}"
    shown, end = apart(value, upper)
    return shown, f"{lower:.4f}", end


def far_outside(position: float, limits: JointLimits) -> str:
    """Describe a position that is too far outside the limits for the joint to be activated; empty if the position is
    acceptable.

    Args:
        position: Joint position, in rad or m.
        limits: Limits of the joint.
    """
    slack = OUTSIDE_TOLERANCE * (limits.upper - limits.lower)
    if limits.lower - slack <= position <= limits.upper + slack:
        return ""
    shown, lower, upper = beyond_range(position, limits.lower, limits.upper)
    return f"is at {shown}, outside its limits {lower} to {upper}"


class ServoHealth(NamedTuple):
    """Health of a servo. This class is a named tuple, because each cycle creates an instance for every servo."""

    voltage_v: float
    temperature_c: float
    alarms: tuple[str, ...] = ()
    counters: ServoCounters | None = None
    """Counters of communication faults since startup."""
    load: float = math.nan
    """Drive in the joint's direction, as a fraction of full drive from -1 to 1."""
    current_a: float = math.nan
    """Motor current in the joint's direction, in A; NaN if the servo does not report it."""
    supply: VoltageFault | None = None
    """Supply voltage fault."""
    stall: Stall | None = None
    """Stall report if the servo pushes without moving."""


class JointFault(NamedTuple):
    """Fault of a joint."""

    kind: FaultKind | Literal["implausible", "no_torque", "component"]
    """Kind of fault.

    - ``implausible``: the measured position was rejected.
    - ``no_torque``: the servo responds, but its torque may be disabled.
    - ``component``: the component is lost, in a transition or inactive.
    - Other types are communication faults of the servo.
    """
    text: str
    """Description that includes the joint and the servo's ID."""


@dataclass(frozen=True, slots=True)
class JointState:
    """Measurement of one cycle. Arrays have shape (n,), in the hardware's joint order.

    A joint with a fault keeps its last known values.
    """

    stamp_s: float
    """Time of the measurement on the control loop's clock, in seconds."""
    position: FloatArray
    """Positions, in rad or m."""
    velocity: FloatArray
    """Velocities, in rad/s or m/s."""
    effort: FloatArray
    """Torques or forces, in N m or N; NaN if unknown."""
    faults: Mapping[str, JointFault] = field(default_factory=dict)
    """Faults, keyed by joint name."""
    health: Mapping[str, ServoHealth] = field(default_factory=dict)
    """Health of joints with a servo, keyed by joint name."""
    extra: Mapping[str, float] = field(default_factory=dict)
    """Values of other state interfaces, keyed by full name (``joint1/acceleration``)."""
    lines: Mapping[str, BusCounters] = field(default_factory=dict)
    """Fault counters of each bus, keyed by serial port."""


@dataclass(frozen=True, slots=True)
class JointCommand:
    """Command for the next period."""

    values: FloatArray
    """Commands of shape (m,), in the order of the hardware's ``command_interfaces``.

    Positions (in rad or m) apply to the end of the period. Velocities are in rad/s or m/s, and efforts in N m or N.
    """
    period_s: float
    """Length of the period, in seconds."""
