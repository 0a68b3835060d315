"""State of an arm as a program sees it, by joint name and in SI units."""

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class ArmState:
    """Measurement of all joints in one cycle. All mappings list the joints in the order of ``Arm.joints``.

    A joint that did not answer in this cycle keeps its last values and has an entry in ``faults``.
    """

    time_s: float
    """Time of the measurement on the clock of the control loop, in seconds."""
    age_s: float
    """Time from the measurement until this object was created, in seconds."""
    position: Mapping[str, float]
    """Measured positions by joint, in rad or m; NaN before the first answer of a servo."""
    velocity: Mapping[str, float]
    """Measured velocities by joint, in rad/s or m/s."""
    effort: Mapping[str, float]
    """Torques or forces by joint, in N m or N; NaN if unknown."""
    temperature: Mapping[str, float]
    """Servo temperatures by joint, in °C; NaN if unknown."""
    command: Mapping[str, float]
    """Positions that the control loop has sent last, in rad or m; NaN before the first command."""
    faults: Mapping[str, str] = field(default_factory=dict)
    """One sentence for each joint with a fault or an alarm. Empty if there is none."""
