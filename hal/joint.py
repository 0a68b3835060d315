"""A joint with its servo, and the conversion between servo counts and joint positions."""

import math
from dataclasses import dataclass, field, replace

from drivers.servos.register import ServoModel
from hal.compensation.servo_compliance import Compliance, compliance_of
from hal.types import JointLimits


@dataclass(frozen=True, slots=True)
class Joint:
    """A joint and the servo that drives it."""

    name: str
    servo_id: int
    model: ServoModel
    limits: JointLimits
    sign: int = 1
    """Direction of the servo: +1 if counts increase with the joint position, otherwise -1."""
    zero_counts: int = 2048
    """Servo counts at joint position 0."""
    transmission: float = 1.0
    """Joint units per radian of the servo shaft: 1.0 for a revolute joint without a gear, m/rad for a prismatic
    joint."""
    reduction: float = 1.0
    """Gear ratio: turns of the servo per turn of the gear output. ``transmission`` already includes this reduction."""
    homing_offset: int | None = None
    """Homing offset that the servo must have for ``zero_counts`` to be valid; None if the offset is not checked."""
    extended: bool = False
    """Whether the servo, a Dynamixel X, must be in extended position mode because the joint moves past the last
    count."""
    seam_inside: bool = False
    """Whether the joint may move from the servo's last count to the first, which is possible before a calibration."""
    torque_limit: float = 1.0
    """Fraction of full drive that the servo may use, from 0 to 1."""
    bus: str = ""
    """Name of the servo's bus; empty if there is only one bus."""
    position_p: int | None = None
    """Position P gain of the servo, if the robot file sets one."""
    firmware: int | None = None
    """Firmware version of the virtual servo, a Dynamixel X; None to use the usual version."""
    settings: tuple[tuple[str, int], ...] = ()
    """Names and values of the EEPROM registers that the robot file sets."""
    gravity_compensation: bool = True
    """Whether goals may differ from commands to compensate for the servo's compliance."""

    stops: tuple[float, float] | None = None
    """Ends of the joint's travel, in rad or m, if soft limits or a <command_interface> narrow ``limits``."""

    _units_per_count: float = field(init=False, repr=False, compare=False)
    _counts_range: tuple[int, int] | None = field(init=False, repr=False, compare=False, default=None)
    """Cached servo range within the limits, because each cycle needs it."""

    def __post_init__(self) -> None:
        units = self.sign * self.transmission * 2.0 * math.pi / self.model.counts_per_turn
        object.__setattr__(self, "_units_per_count", units)

    def between_stops(self) -> "Joint":
        """Return the joint with limits that cover its whole travel, as measured by calibration.

        Returns:
            A joint whose limits are its stops; the joint itself if it has no ``stops``.
        """
        if self.stops is None:
            return self
        return replace(self, limits=replace(self.limits, lower=self.stops[0], upper=self.stops[1]))

    @property
    def address(self) -> str:
        """Address of the servo in the robot: its ID, or the bus and ID if buses have names (``hand/1``)."""
        return f"{self.bus}/{self.servo_id}" if self.bus else str(self.servo_id)

    @property
    def unit(self) -> str:
        """Unit of the joint position: "rad", or "m" if the joint is prismatic."""
        return "rad" if math.isclose(self.transmission * self.reduction, 1.0) else "m"

    @property
    def units_per_count(self) -> float:
        """Signed change of the joint position per count, in rad or m."""
        return self._units_per_count

    @property
    def full_effort(self) -> float:
        """Torque or force at full drive and at standstill, in N m or N."""
        return self.model.stall_torque_nm / self.transmission

    @property
    def compliance(self) -> Compliance | None:
        """Stiffness and lag of the joint; None if they are unknown."""
        return compliance_of(self.model, self.position_p, self.transmission, dict(self.settings))

    def turns(self, counts: int) -> int:
        """Return the number of whole turns in a reading. A servo counts turns from the time it is powered on.

        Args:
            counts: Reading of the servo, in counts.

        Returns:
            Number of whole turns.
        """
        return counts // self.model.counts_per_turn

    def position(self, counts: int) -> float:
        """Convert counts to a joint position.

        Args:
            counts: Reading of the servo, in counts.

        Returns:
            The joint position, in rad or m.
        """
        return (counts - self.zero_counts) * self.units_per_count

    def counts(self, position: float) -> int:
        """Convert a joint position to counts, clamped to the joint's limits.

        Args:
            position: Joint position, in rad or m.

        Returns:
            The nearest servo position within the limits, in counts.

        Raises:
            ValueError: The position is NaN.
        """
        lower, upper = self.counts_range()
        # Clamp before rounding, because infinity cannot be rounded.
        inside = min(max(position, self.limits.lower), self.limits.upper)
        return min(max(round(inside / self.units_per_count) + self.zero_counts, lower), upper)

    def counts_range(self) -> tuple[int, int]:
        """Return the servo's range within the joint limits.

        Returns:
            The lowest and highest counts within the limits.
        """
        if self._counts_range is None:
            ends = (self.limits.lower / self.units_per_count, self.limits.upper / self.units_per_count)
            # The margin of 1e-9 keeps rounding errors from changing a limit that is a whole number of counts.
            lowest, highest = math.ceil(min(ends) - 1e-9), math.floor(max(ends) + 1e-9)
            object.__setattr__(self, "_counts_range", (lowest + self.zero_counts, highest + self.zero_counts))
        assert self._counts_range is not None
        return self._counts_range
