"""Gravity compensation: offset the goals from the commands so that compliant servos reach the commands.

A servo without an integral term sags under load. The sag due to the link masses is computed from the URDF. The
remaining error at rest is measured and corrected slowly, within narrow limits. This error is caused by friction, the
dead band and a load in the hand.
"""

import math
from collections.abc import Collection, Sequence

import numpy as np

from hal.compensation.gravity import Gravity
from hal.compensation.joint_offset import GUIDED_SHARE, JointOffset
from hal.joint import Joint
from hal.servos.servo_states import ServoStates
from hal.types import FloatArray, JointCommand


class GravityCompensation:
    """Offsets for the joints of one component, updated in each cycle. Arrays have shape (n,), in rad or m."""

    def __init__(self, joints: Sequence[Joint], gravity: Gravity | None) -> None:
        """Create the compensation.

        Args:
            joints: The joints.
            gravity: Gravity model with the joints in the same order; None to use only the slow correction.
        """
        self._joints = tuple(joints)
        self._gravity = gravity
        self._torques, self._weighed = [0.0] * len(joints), [math.nan] * len(joints)
        """Torques due to gravity, and the command for which they were computed."""
        self._each = [JointOffset(joint) for joint in joints]
        self.enabled = True
        """Whether offsets are applied. The offsets fade in and out slowly."""
        self.guided = False
        """Whether the arm is being moved by hand. If so, less of the weight is compensated for, and the slow correction
        is off.
        """
        self.restart()

    def restart(self, joints: Collection[str] | None = None) -> None:
        """Reset the offsets of joints to zero when they are activated. If None, reset the offsets of all joints."""
        for joint, own in zip(self._joints, self._each, strict=True):
            if joints is None or joint.name in joints:
                own.restart()
            else:
                own.pause()
        self._last: list[float] | None = None
        self.offsets: FloatArray = np.array([own.offset for own in self._each])
        """Offsets to add to the next command."""

    def update(self, command: JointCommand, states: ServoStates) -> None:
        """Compute the offsets for the next command, which is extrapolated from the last two commands."""
        counts, withheld = states.measured, states.faults.withheld
        measured = [
            joint.position(counts[joint.name]) if joint.name in counts and joint.name not in withheld else math.nan
            for joint in self._joints
        ]
        here = command.values.tolist()
        ahead = here if self._last is None else [2.0 * now - last for now, last in zip(here, self._last, strict=True)]
        self._last = here
        inside = [own.inside(goal, now) for own, goal, now in zip(self._each, ahead, here, strict=True)]
        self.offsets = self._offset(inside, measured, command.period_s)

    def offset(self, command: FloatArray, measured: FloatArray, dt_s: float) -> FloatArray:
        """Compute the offsets for a command that has passed the gate.

        Command plus offset stays within the joint's limits. The speed is limited later, during the conversion to
        counts.

        Args:
            command: Commanded positions, shape (n,).
            measured: Measured positions, shape (n,). NaN for a joint that was not measured, which keeps its offset.
            dt_s: Period of the control loop, in seconds.

        Returns:
            Offsets of shape (n,).
        """
        return self._offset(command.tolist(), measured.tolist(), dt_s)

    def _offset(self, command: list[float], measured: list[float], dt_s: float) -> FloatArray:
        if self._gravity is not None and command != self._weighed:  # an arm at rest needs only one computation
            self._weighed, self._torques = command, self._gravity.torques_at(command)
        share = self.enabled * (GUIDED_SHARE if self.guided else 1.0)
        each = zip(self._each, command, measured, self._torques, strict=True)
        return np.array([own.update(goal, at, torque, dt_s, share) for own, goal, at, torque in each])
