"""Convert servo counts to joint positions and back."""

import math
from dataclasses import dataclass, replace

from drivers.servos.register import ServoModel
from hal.compensation.servo_compliance import Compliance, compliance_of
from hal.types import JointLimits


@dataclass(frozen=True, slots=True)
class Joint:
    """Driven joint and its servo."""

    name: str
    """Name in the URDF."""
    servo_id: int
    """ID of the servo on its bus."""
    model: ServoModel
    """Model of the servo."""
    limits: JointLimits
    """Limits of the joint."""
    sign: int = 1
    """+1 if the joint's position grows with the counts, otherwise -1."""
    zero_counts: int = 2048
    """Reading of the servo at joint position 0, in counts."""
    transmission: float = 1.0
    """Joint units per radian of the servo's shaft: 1.0 for a revolute joint, metres for a prismatic one."""
    homing_offset: int | None = None
    """Homing offset of the servo with which ``zero_counts`` is valid; None if it is not checked."""
    extended: bool = False
    """Whether the servo, a Dynamixel X, must be in extended position mode because its seam is within the joint's
    range."""
    seam_inside: bool = False
    """Whether the servo may wrap from its last count to its first within the limits, as before a calibration."""
    torque_limit: float = 1.0
    """Share of full drive that the servo may use, 0 to 1."""
    bus: str = ""
    """Name of the servo's bus; empty if there is only one."""
    position_p: int | None = None
    """Position P gain of the servo, if the robot file sets one."""
    settings: tuple[tuple[str, int], ...] = ()
    """Names of EEPROM registers and their values, from the robot file."""
    gravity_compensation: bool = True
    """Whether the goals of the servo may differ from the commands, to compensate for its sag under load."""

    stops: tuple[float, float] | None = None
    """Ends of the joint's travel, if ``limits`` are narrower because its <command_interface> limits the commands."""

    def between_stops(self) -> "Joint":
        """Return the joint with its whole travel as its limits, as calibration measures it.

        Returns:
            A joint whose limits are its stops; the joint itself if it has no ``stops``.
        """
        if self.stops is None:
            return self
        return replace(self, limits=replace(self.limits, lower=self.stops[0], upper=self.stops[1]))

    @property
    def address(self) -> str:
        """Address of the servo in the robot: its ID, with the name of its bus if buses have names (``hand/1``)."""
        return f"{self.bus}/{self.servo_id}" if self.bus else str(self.servo_id)

    @property
    def units_per_count(self) -> float:
        """Joint position per count, in rad or m, with the sign."""
        return self.sign * self.transmission * 2.0 * math.pi / self.model.counts_per_turn

    @property
    def full_effort(self) -> float:
        """Effort at full drive and standstill, in N m or N."""
        return self.model.stall_torque_nm / self.transmission

    @property
    def compliance(self) -> Compliance | None:
        """How far the joint yields and lags; None if this is unknown."""
        return compliance_of(self.model, self.position_p, self.transmission, dict(self.settings))

    def turns(self, counts: int) -> int:
        """Return the number of whole turns in a reading. A servo counts turns from its power-on.

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
        # Clamp the position first, because infinity cannot be rounded. NaN passes and raises ValueError.
        inside = min(max(position, self.limits.lower), self.limits.upper)
        return min(max(round(inside / self.units_per_count) + self.zero_counts, lower), upper)

    def counts_range(self) -> tuple[int, int]:
        """Return the range of the servo within the joint's limits.

        Returns:
            The lowest and the highest count within the limits.
        """
        ends = (self.limits.lower / self.units_per_count, self.limits.upper / self.units_per_count)
        # The margin of 1e-9 keeps a limit that is a whole number of counts from losing one to rounding.
        return (
            math.ceil(min(ends) - 1e-9) + self.zero_counts,
            math.floor(max(ends) + 1e-9) + self.zero_counts,
        )
