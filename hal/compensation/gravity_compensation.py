"""Gravity compensation: offset the goals from the commands so that compliant servos reach the commands.

A servo without an integral term sags under load. The sag due to the link masses in the URDF is computed. The remaining
error at rest (friction, dead band, a load in the hand) is corrected slowly and within narrow limits from measurements.
"""

import math
from collections.abc import Collection, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hal.compensation.gravity import Gravity
from hal.compensation.limit_cycle import LimitCycle
from hal.joint import Joint
from hal.servos.servo_states import ServoStates
from hal.types import FloatArray, JointCommand

GUIDED_SHARE: Final = 0.75
"""Compensated share of the weight if the arm is moved by hand.

Servos are up to 1.7 times as strong as in their data sheets (BAM's identification of an STS3215). An arm that rises
without being touched is worse than an arm whose gears carry part of the weight."""
FADE_IN_S: Final = 1.0
"""Time in which the offsets increase from zero after activation, so that the activation itself moves nothing."""
LARGEST_LOAD: Final = 0.5
"""Maximum torque for compensation, as a share of full effort. A higher value indicates wrong masses in the URDF."""
CORRECTION_S: Final = 0.5
"""Time constant of the slow correction. It is much longer than the servos' lag and the cycle."""
REST_S: Final = 0.2
"""Time after the last change of the command until the correction begins, because the joint still moves before."""
STILL: Final = 1e-6
"""Maximum change per cycle (rad or m) of a command at rest. A command to the measured position is thus at rest."""
BLOCKED: Final = 2.0
"""Error above which a joint counts as blocked and is not corrected, as a multiple of the servo's error at rest."""


class GravityCompensation:
    """Offsets of the joints of one component, updated in each cycle. Arrays have shape (n,), in rad or m."""

    def __init__(self, joints: Sequence[Joint], gravity: Gravity | None, guided: bool = False) -> None:
        """Create the compensation.

        Args:
            joints: The joints.
            gravity: Gravity model with the joints in the same order; None for the slow correction only.
            guided: Whether the arm is moved by hand. Then there is no slow correction, because it would work against
                the hand.
        """
        known = [joint.compliance if joint.gravity_compensation else None for joint in joints]
        limits = [joint.limits for joint in joints]
        self._joints = tuple(joints)
        self._gravity = gravity
        self._carried = GUIDED_SHARE if guided else 1.0
        self._softness = np.array([1.0 / one.stiffness if one else 0.0 for one in known])
        self._load = np.array([LARGEST_LOAD * joint.full_effort * joint.torque_limit for joint in joints])
        self._uncorrected = np.array([one.uncorrected if one and not guided else 0.0 for one in known])
        self._dead_band = np.array([one.dead_band if one else math.inf for one in known])
        self._lower, self._upper = np.array([one.lower for one in limits]), np.array([one.upper for one in limits])
        self._limit_cycle = LimitCycle(self._dead_band, np.array([joint.transmission for joint in joints]))
        self.enabled = True
        """Whether offsets are applied. They fade in and out slowly."""
        self._share = self._offset = self._correction = self._rested_s = np.zeros(len(joints))
        self.restart()

    def restart(self, joints: Collection[str] | None = None) -> None:
        """Reset the offsets to zero at the activation of joints (None: all joints)."""
        others = np.array([joints is not None and joint.name not in joints for joint in self._joints])
        self._share, self._offset, self._correction, self._rested_s = (
            np.where(others, values, 0.0) for values in (self._share, self._offset, self._correction, self._rested_s)
        )
        self._limit_cycle.restart()
        self._command: FloatArray | None = None
        self._last: FloatArray | None = None
        self.offsets = self._offset
        """Offsets to add to the next command."""

    def update(self, command: JointCommand, states: ServoStates) -> None:
        """Compute the offsets for the next command, which is extrapolated from the last two commands."""
        counts = {name: at for name, at in states.measured.items() if name not in states.faults.withheld}
        measured = [j.position(counts[j.name]) if j.name in counts else math.nan for j in self._joints]
        here = command.values
        ahead = here if self._last is None else 2.0 * here - self._last
        self._last = here.copy()
        next_one = np.clip(ahead, np.minimum(self._lower, here), np.maximum(self._upper, here))
        self.offsets = self.offset(next_one, np.array(measured), command.period_s)

    def offset(self, command: FloatArray, measured: FloatArray, dt_s: float) -> FloatArray:
        """Compute the offsets for a command that has passed the gate.

        Command plus offset stays within the joint's limits. Its speed is limited later, when it is converted to counts.

        Args:
            command: Commanded positions, shape (n,).
            measured: Measured positions, shape (n,). NaN for a joint without measurement, which keeps its offset.
            dt_s: Period of the control loop, in seconds.

        Returns:
            Offsets of shape (n,).
        """
        before = command if self._command is None else self._command
        missing = np.isnan(measured)
        sag = self._sag(command)
        at_rest = np.abs(command - before) < STILL
        # If gravity turns a joint beyond its dead band, it presses the gear against one side of the backlash.
        loose = at_rest & (np.abs(sag) < self._dead_band)
        self._limit_cycle.update(command - measured, loose, dt_s)
        self._correct(command, before, measured, at_rest, dt_s)
        found = self._share * (sag + self._correction + self._limit_cycle.offset)
        goal = command + np.where(missing, self._offset, found)
        self._offset = np.clip(goal, np.minimum(self._lower, command), np.maximum(self._upper, command)) - command
        self._command = command.copy()
        change = dt_s / FADE_IN_S
        self._share = np.minimum(self._share + change, 1.0) if self.enabled else np.maximum(self._share - change, 0.0)
        return self._offset

    def _sag(self, position: FloatArray) -> FloatArray:
        if self._gravity is None:
            return np.zeros_like(position)
        sag: FloatArray = np.clip(self._gravity.torques(position), -self._load, self._load)
        sag *= self._carried * self._softness
        return sag

    def _correct(
        self, command: FloatArray, before: FloatArray, measured: FloatArray, at_rest: NDArray[np.bool_], dt_s: float
    ) -> None:
        """Integrate the remaining error of joints at rest, after the offsets have fully faded in."""
        self._rested_s = np.where(at_rest, self._rested_s + dt_s, 0.0)
        error = command - measured
        off = np.abs(error)
        goal = before + self._offset
        free = (self._rested_s > REST_S) & (off > self._dead_band) & (off < BLOCKED * self._uncorrected)  # not for NaN
        free &= ~self._limit_cycle.swinging & (goal > self._lower) & (goal < self._upper)
        self._correction[self._limit_cycle.swinging] = 0.0
        free &= self._share >= 1.0
        if free.any():
            step = np.where(free, error * min(dt_s / CORRECTION_S, 1.0), 0.0)
            self._correction = np.clip(self._correction + step, -self._uncorrected, self._uncorrected)
