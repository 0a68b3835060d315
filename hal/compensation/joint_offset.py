"""Compute the offset that is added to a joint's command to obtain its goal, in rad or m.

Plain floats are faster here than arrays, because an arm has few joints and the offsets change in every cycle.
"""

import math
from typing import Final

from hal.compensation.limit_cycle import LimitCycle
from hal.joint import Joint

GUIDED_SHARE: Final = 0.75
"""Fraction of the weight to compensate while the arm is moved by hand. Servos are up to 1.7 times as strong as their
datasheets state (according to BAM's identification of an STS3215). An arm that rises by itself is worse than an arm
whose gears carry part of the weight.
"""
FADE_IN_S: Final = 1.0
"""Duration of the offsets' fade-in after activation, in seconds. The fade-in prevents the arm from jumping."""
LARGEST_LOAD: Final = 0.5
"""Maximum torque used for compensation, as a fraction of full effort. A higher value indicates wrong masses in the
URDF."""
CORRECTION_S: Final = 0.5
"""Time constant of the slow correction, in seconds. The time constant is much longer than one cycle and the lag of the
servos."""
REST_S: Final = 0.2
"""Delay between the last change of the command and the start of the correction, in seconds. During this delay, the
joint may still be moving.
"""
STILL: Final = 1e-6
"""Maximum change per cycle at which a command counts as at rest, in rad or m. A command that repeats the measured
position also counts as at rest.
"""
BLOCKED: Final = 2.0
"""Maximum error to correct, as a multiple of the servo's error at rest. A joint with a larger error counts as blocked.
"""


class JointOffset:
    """Offset of one joint. The offset combines the sag, the slow correction and the damping of the limit cycle."""

    def __init__(self, joint: Joint) -> None:
        known = joint.compliance if joint.gravity_compensation else None
        self._load = LARGEST_LOAD * joint.full_effort * joint.torque_limit
        self._sag_per_torque = 1.0 / known.stiffness if known else 0.0
        self._uncorrected = known.uncorrected if known else 0.0
        self._dead_band = known.dead_band if known else math.inf
        self._lower, self._upper = joint.limits.lower, joint.limits.upper
        self._limit_cycle = LimitCycle(self._dead_band, joint.transmission)
        self.restart()

    def restart(self) -> None:
        """Reset the offset to zero when the joint is activated."""
        self._share = self._correction = self._rested_s = 0.0
        self.offset = 0.0
        """Offset for the last command."""
        self.pause()

    def pause(self) -> None:
        """Discard the last command, because other joints of the component have been activated.

        The offset stays unchanged.
        """
        self._limit_cycle.restart()
        self._command: float | None = None

    def inside(self, goal: float, command: float) -> float:
        """Clamp the goal to the joint limits, or to the command if the command is outside the limits."""
        return min(max(goal, min(self._lower, command)), max(self._upper, command))

    def update(self, command: float, measured: float, torque: float, dt_s: float, share: float) -> float:
        """Compute the offset for a command that has passed the gate.

        Args:
            command: Commanded position.
            measured: Measured position. If it is NaN (not measured), the offset does not change.
            torque: Torque or force due to gravity, in N m or N.
            dt_s: Period of the control loop, in seconds.
            share: Fraction of the offset to apply, from 0 to 1. Below 1, the slow correction is off, because it would
                resist a hand that moves the arm.

        Returns:
            The offset.
        """
        before = command if self._command is None else self._command
        sag = self._sag(torque)
        at_rest, error = abs(command - before) < STILL, command - measured
        # If gravity turns a joint beyond its dead band, gravity also presses the gear against one side of the backlash.
        self._limit_cycle.update(error, at_rest and abs(sag) < self._dead_band, dt_s)
        self._rested_s = self._rested_s + dt_s if at_rest else 0.0
        self._correct(before, error, sag, dt_s, share)
        wanted = (
            self.offset if math.isnan(measured) else self._share * (sag + self._correction + self._limit_cycle.offset)
        )
        self.offset = self.inside(command + wanted, command) - command
        self._command = command
        change = dt_s / FADE_IN_S
        self._share += min(max(share - self._share, -change), change)
        return self.offset

    def _sag(self, torque: float) -> float:
        return min(max(torque, -self._load), self._load) * self._sag_per_torque

    def _correct(self, before: float, error: float, sag: float, dt_s: float, share: float) -> None:
        """After the offset has fully faded in, integrate the remaining error of a joint at rest.

        Load increases the friction of a gear, so a joint that gravity moves towards its goal can stop far from it. The
        correction may therefore reduce the drive that carries the weight to zero, but it never reverses this drive.
        """
        lower, upper = -max(self._uncorrected, sag), max(self._uncorrected, -sag)
        if 0.0 < share < 1.0:
            self._correction -= self._correction * min(dt_s / CORRECTION_S, 1.0)
        elif self._limit_cycle.swinging:
            self._correction = 0.0
        elif self._rested_s == 0.0:
            usual = min(max(self._correction, -self._uncorrected), self._uncorrected)
            self._correction += (usual - self._correction) * min(dt_s / CORRECTION_S, 1.0)
        elif (
            self._rested_s > REST_S
            and self._dead_band < abs(error) < BLOCKED * (upper if error > 0.0 else -lower)  # not for NaN
            and self._lower < before + self.offset < self._upper
            and self._share >= 1.0
        ):
            self._correction += error * min(dt_s / CORRECTION_S, 1.0)
        self._correction = min(max(self._correction, lower), upper)
