"""The freedrive controller: each joint stays where it is until a hand turns it, and then goes along."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np

from controller.interface import indices
from controller.parameters import Parameters
from hal.compensation.gravity_compensation import FADE_IN_S
from hal.compensation.servo_compliance import Compliance, lags
from hal.joint import Joint
from hal.types import FloatArray, JointLimits, JointState

SMOOTHED_S: Final = 0.04
"""The time constant of the joints' velocities."""
LED_RAD_S: Final = 1.0
"""Of a servo's shaft: up to so fast it is helped along. A servo that lags less than is known of it must not take that
for a push, and go on by itself."""


SLACK: Final = 0.15
"""Share of a servo's full drive with which a soft joint resists the hand, beside its gears' friction."""


@dataclass(frozen=True, slots=True)
class GuidedJoint:
    """A joint that a hand may move, in rad or m."""

    joint: str
    limits: JointLimits
    slack: float
    """The set-point is never further from where the joint is measured, as far as no hand moves it."""
    compliance: Compliance | None = None
    """How far its servo lags; None: it is taken to follow at once."""
    transmission: float = 1.0
    """Joint units per radian of the servo's shaft."""


def guided_joint(joint: Joint) -> GuidedJoint:
    """The joint as a hand may move it. Its servo pulls with ``SLACK`` of its full drive at most, as far as is known."""
    slack = SLACK * joint.full_effort / joint.compliance.stiffness if joint.compliance else 0.0
    return GuidedJoint(joint.name, joint.limits, slack, joint.compliance, joint.transmission)


class FreedriveController:
    """The set-point of a joint stays while it is within the slack. So the servo holds the joint like a brake that
    slips: a push weaker than the servo's pull at that error moves it no further, a stronger one takes it along, and it
    stays where it is left.

    The hardware's gravity compensation carries the links' weight; until that has come the joints are only held.
    """

    kind: ClassVar[str] = "servoloop/FreedriveController"

    def __init__(self, name: str, joints: Sequence[GuidedJoint], hardware_joints: Sequence[str]) -> None:
        self.name = name
        self.parameters = Parameters()
        self.joints = tuple(one.joint for one in joints)
        self.command_interfaces = tuple(f"{joint}/position" for joint in self.joints)
        self.state_interfaces = self.command_interfaces
        self.command: FloatArray = np.full(len(joints), np.nan)
        self.holds = False
        """Whether the joints are to be held where they are; another thread sets it."""
        self.held = False
        """Whether they are held so."""
        self.free = False
        """Whether the joints give way."""
        self._index = indices(self.joints, hardware_joints)
        self._slack = np.array([one.slack for one in joints])
        self._lower, self._upper = np.array([(one.limits.lower, one.limits.upper) for one in joints]).T
        self._fastest = np.array([one.limits.velocity for one in joints])
        self._led = np.array([LED_RAD_S * one.transmission for one in joints])
        self._lags = lags([one.compliance for one in joints])
        self._free_s = 0.0
        self._last: FloatArray | None = None
        """Where the joints were in the cycle before."""
        self._velocity = np.zeros(len(joints))
        """Smoothed."""

    def activate(self, state: JointState, command: FloatArray) -> None:
        self.command = command.copy()
        self._free_s, self.free, self.held = state.stamp_s + FADE_IN_S, False, False
        self._last, self._velocity = None, np.zeros(len(self.joints))

    def deactivate(self, reason: str = "") -> None:
        self.free = False

    def settled(self) -> bool:
        return True

    def update(self, state: JointState, now_s: float, period_s: float) -> None:
        measured = state.position[self._index]
        known = np.array([joint not in state.faults for joint in self.joints])
        self._see(np.where(known, measured, np.nan), period_s)
        if self.held or (not self.holds and now_s < self._free_s):
            return
        self.free, self.held = not self.holds, self.holds
        ahead, slack = (measured, 0.0) if self.holds else (measured + self._lead(period_s), self._slack)
        near = np.clip(np.clip(self.command, ahead - slack, ahead + slack), self._lower, self._upper)
        reach = self._fastest * period_s
        self.command = self.command + np.clip(near - self.command, -reach, reach)

    def _see(self, measured: FloatArray, period_s: float) -> None:
        """Learn the velocities; of a joint that was not measured (NaN) now or before nothing is learnt."""
        way = np.full_like(measured, np.nan) if self._last is None else measured - self._last
        self._velocity += (np.nan_to_num(way) / period_s - self._velocity) * min(1.0, period_s / SMOOTHED_S)
        self._last = measured

    def _lead(self, period_s: float) -> FloatArray:
        """How far the joints have gone on (n,) when their servos pull at the new set-points, which would drag else."""
        velocity = np.clip(self._velocity, -self._led, self._led)
        lag_s, profile_acceleration, _ = self._lags
        lead: FloatArray = velocity * (lag_s + period_s) + velocity * np.abs(velocity) / (2.0 * profile_acceleration)
        return lead
