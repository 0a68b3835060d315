"""Gravity compensation: goals a little beyond the commands, so that soft servos bring the joints to the commands.

A servo without an integral part gives way under load. What the URDF's masses explain is known beforehand; what is left
at rest (friction, dead band, a load in the hand) is found from the measurement, slowly and within narrow limits.
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
"""Of the weight, where a hand moves the joints: servos pull up to 1.7 times what their data sheets say (BAM's
identification of an STS3215), and an arm that rises by itself is worse than one that leans a little on its gears."""
FADE_IN_S: Final = 1.0
"""The offsets grow from zero in this time after activation, which itself moves nothing."""
LARGEST_LOAD: Final = 0.5
"""Share of full effort: an arm that needs more to hold itself is not built so, its URDF's masses are wrong."""
CORRECTION_S: Final = 0.5
"""Time constant of the slow correction, far above the servos' own lag and the cycle."""
REST_S: Final = 0.2
"""The correction begins so long after the last change of the command: until then the joint is on its way."""
STILL: Final = 1e-6
"""A command that changes by less in a cycle (rad or m) stands: a goal for where the joint is ends no rest."""
BLOCKED: Final = 2.0
"""A joint at rest that is off by more than so many times what servos leave is held by something: no correction."""


class GravityCompensation:
    """The offsets of one component's joints; one update a cycle. Arrays (n,), rad or m."""

    def __init__(self, joints: Sequence[Joint], gravity: Gravity | None, guided: bool = False) -> None:
        """``gravity`` has the joints in the same order; None: the slow correction alone.

        ``guided``: a hand moves the joints, which has to hold against what is left of the weight. The slow correction
        would work against the hand, and there is none.
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
        """Whether there are offsets; they come and go slowly."""
        self._share = self._offset = self._correction = self._rested_s = np.zeros(len(joints))
        self.restart()

    def restart(self, joints: Collection[str] | None = None) -> None:
        """Begin anew, at activation of these joints (None: all): their first offset is zero."""
        others = np.array([joints is not None and joint.name not in joints for joint in self._joints])
        self._share, self._offset, self._correction, self._rested_s = (
            np.where(others, values, 0.0) for values in (self._share, self._offset, self._correction, self._rested_s)
        )
        self._limit_cycle.restart()
        self._command: FloatArray | None = None
        self._last: FloatArray | None = None
        self.offsets = self._offset
        """What to add to the next command."""

    def update(self, command: JointCommand, states: ServoStates) -> None:
        """Find the offsets for the command that follows on this one, which is taken to go on as it did."""
        counts = {name: at for name, at in states.measured.items() if name not in states.faults.withheld}
        measured = [j.position(counts[j.name]) if j.name in counts else math.nan for j in self._joints]
        here = command.values
        ahead = here if self._last is None else 2.0 * here - self._last
        self._last = here.copy()
        next_one = np.clip(ahead, np.minimum(self._lower, here), np.maximum(self._upper, here))
        self.offsets = self.offset(next_one, np.array(measured), command.period_s)

    def offset(self, command: FloatArray, measured: FloatArray, dt_s: float) -> FloatArray:
        """The offsets for ``command``, which has passed the gate; ``measured`` is NaN where the servo is missing.

        Command and offset together stay within the joint's limits; how fast they go is limited where they become
        counts. The offset of a joint that is missing stays.
        """
        before = command if self._command is None else self._command
        missing = np.isnan(measured)
        sag = self._sag(command)
        stands = np.abs(command - before) < STILL
        # Where gravity turns the joint by more than the servo leaves alone, it holds the link against the gear's teeth.
        loose = stands & (np.abs(sag) < self._dead_band)
        self._limit_cycle.update(command - measured, loose, dt_s)
        self._correct(command, before, measured, stands, dt_s)
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
        self, command: FloatArray, before: FloatArray, measured: FloatArray, stands: NDArray[np.bool_], dt_s: float
    ) -> None:
        """Integrate what remains of the error of joints that rest, once what is known has been compensated."""
        self._rested_s = np.where(stands, self._rested_s + dt_s, 0.0)
        error = command - measured
        off = np.abs(error)
        goal = before + self._offset
        free = (self._rested_s > REST_S) & (off > self._dead_band) & (off < BLOCKED * self._uncorrected)  # NaN: not
        free &= ~self._limit_cycle.swinging & (goal > self._lower) & (goal < self._upper)
        self._correction[self._limit_cycle.swinging] = 0.0
        free &= self._share >= 1.0
        if free.any():
            step = np.where(free, error * min(dt_s / CORRECTION_S, 1.0), 0.0)
            self._correction = np.clip(self._correction + step, -self._uncorrected, self._uncorrected)
