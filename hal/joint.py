"""From servo counts to joint positions and back."""

import math
from dataclasses import dataclass, replace

from drivers.servos.register import ServoModel
from hal.compensation.servo_compliance import Compliance, compliance_of
from hal.types import JointLimits


@dataclass(frozen=True, slots=True)
class Joint:
    """One driven joint and the servo behind it.

    ``sign`` is +1 or -1, ``zero_counts`` the servo's reading at joint position 0, ``transmission``
    joint units per radian of the servo's shaft: 1.0 for a revolute joint, metres for a prismatic one.
    """

    name: str
    servo_id: int
    model: ServoModel
    limits: JointLimits
    sign: int = 1
    zero_counts: int = 2048
    transmission: float = 1.0
    homing_offset: int | None = None
    """What the servo's homing offset must be for ``zero_counts`` to be true; None: it is not looked at."""
    extended: bool = False
    """Whether the servo, a Dynamixel X, must be in extended position mode: its seam is within the joint's range."""
    seam_inside: bool = False
    """Whether the servo may pass from its last count to its first within the limits, as before a calibration."""
    torque_limit: float = 1.0
    """Share (0 to 1) of full drive that the servo may use."""
    bus: str = ""
    """The name of the bus that the servo is on; empty where there is only one."""
    position_p: int | None = None
    """The servo's position P gain, where the robot file chose one."""
    settings: tuple[tuple[str, int], ...] = ()
    """Registers of the servo's EEPROM and what they are to hold, as the robot file names them."""
    gravity_compensation: bool = True
    """Whether the servo's goals may differ from the commands to make up for what it gives way under load."""

    stops: tuple[float, float] | None = None
    """Where the joint's travel ends, if ``limits`` are narrower because its <command_interface> limits the commands."""

    def between_stops(self) -> "Joint":
        """The joint with the whole of its travel, as calibration measures it."""
        if self.stops is None:
            return self
        return replace(self, limits=replace(self.limits, lower=self.stops[0], upper=self.stops[1]))

    @property
    def address(self) -> str:
        """Which servo, among all of the robot: its ID, behind its bus where buses have names (``hand/1``)."""
        return f"{self.bus}/{self.servo_id}" if self.bus else str(self.servo_id)

    @property
    def units_per_count(self) -> float:
        """rad or m per count, with the sign."""
        return self.sign * self.transmission * 2.0 * math.pi / self.model.counts_per_turn

    @property
    def full_effort(self) -> float:
        """N m or N at full drive and standstill."""
        return self.model.stall_torque_nm / self.transmission

    @property
    def compliance(self) -> Compliance | None:
        """How far the joint gives way and lags; None where nobody knows."""
        return compliance_of(self.model, self.position_p, self.transmission, dict(self.settings))

    def turns(self, counts: int) -> int:
        """The whole turns that a servo's reading has counted beyond its own; a servo begins anew at power-on."""
        return counts // self.model.counts_per_turn

    def position(self, counts: int) -> float:
        """Joint position in rad or m."""
        return (counts - self.zero_counts) * self.units_per_count

    def counts(self, position: float) -> int:
        """The servo's position nearest to a joint position, never outside the joint's limits."""
        lower, upper = self.counts_range()
        # First the position: infinity cannot be rounded. NaN comes through, and raises ValueError.
        inside = min(max(position, self.limits.lower), self.limits.upper)
        return min(max(round(inside / self.units_per_count) + self.zero_counts, lower), upper)

    def counts_range(self) -> tuple[int, int]:
        """The outermost counts that lie within the limits."""
        ends = (self.limits.lower / self.units_per_count, self.limits.upper / self.units_per_count)
        # 1e-9: a limit that is a whole number of counts must not lose one to rounding.
        return (
            math.ceil(min(ends) - 1e-9) + self.zero_counts,
            math.floor(max(ends) + 1e-9) + self.zero_counts,
        )
