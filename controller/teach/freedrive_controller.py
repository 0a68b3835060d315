"""Let the user move the joints of an arm by hand. Each joint holds its position until it is moved by hand."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np

from controller.interface import indices
from controller.parameters import Parameters
from hal.compensation.joint_offset import FADE_IN_S
from hal.compensation.servo_compliance import Compliance, lags
from hal.joint import Joint
from hal.types import FloatArray, JointLimits, JointState, position_interfaces

SMOOTHED_S: Final = 0.04
"""Time constant of the filter for joint velocities, in seconds."""
LED_RAD_S: Final = 1.0
"""Maximum shaft speed at which servo lag is compensated, in rad/s.

A servo whose actual lag is shorter than its known lag must not mistake the compensation for a push and keep moving.
"""


SLACK: Final = 0.15
"""Fraction of a servo's full drive with which a free joint resists motion by hand, in addition to gear friction."""


@dataclass(frozen=True, slots=True)
class GuidedJoint:
    """A joint that may be moved by hand, in rad or m."""

    joint: str
    limits: JointLimits
    slack: float
    """Maximum distance of the set point from the measured position while the joint is not moved by hand."""
    compliance: Compliance | None = None
    """Compliance and lag of the servo. None means that the servo follows immediately."""
    transmission: float = 1.0
    """Joint units per radian of the servo's shaft."""


def guided_joint(joint: Joint) -> GuidedJoint:
    """Describe a joint that may be moved by hand. The joint's servo pulls with at most ``SLACK`` of its full drive."""
    slack = SLACK * joint.full_effort / joint.compliance.stiffness if joint.compliance else 0.0
    return GuidedJoint(joint.name, joint.limits, slack, joint.compliance, joint.transmission)


class FreedriveController:
    """Controller that allows the joints to be moved by hand.

    A joint's set point stays constant while the joint is within the slack, so the servo acts like a slipping brake. A
    push that is weaker than the servo's pull at this error does not move the joint further. A stronger push moves the
    joint, which then stays where the user leaves it.

    The hardware's gravity compensation carries the weight of the links. The joints are held until the gravity
    compensation has faded in.
    """

    kind: ClassVar[str] = "servoloop/FreedriveController"

    def __init__(self, name: str, joints: Sequence[GuidedJoint], hardware_joints: Sequence[str]) -> None:
        self.name = name
        self.parameters = Parameters()
        self.joints = tuple(guided.joint for guided in joints)
        self.command_interfaces = position_interfaces(self.joints)
        self.state_interfaces = self.command_interfaces
        self.command: FloatArray = np.full(len(joints), np.nan)
        self.holds = False
        """Whether the joints must hold their positions. This flag is set by another thread."""
        self.held = False
        """Whether the joints are being held because of ``holds``."""
        self.free = False
        """Whether the joints can be moved by hand."""
        self._index = indices(self.joints, hardware_joints)
        self._slack = np.array([guided.slack for guided in joints])
        self._lower, self._upper = np.array([(guided.limits.lower, guided.limits.upper) for guided in joints]).T
        self._fastest = np.array([guided.limits.velocity for guided in joints])
        self._led = np.array([LED_RAD_S * guided.transmission for guided in joints])
        self._lags = lags([guided.compliance for guided in joints])
        self._free_s = 0.0
        self._last: FloatArray | None = None
        """Positions of the joints in the previous cycle."""
        self._velocity = np.zeros(len(joints))
        """Smoothed velocities of the joints."""

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
        self._update_velocity(np.where(known, measured, np.nan), period_s)
        if self.held or (not self.holds and now_s < self._free_s):
            return
        self.free, self.held = not self.holds, self.holds
        ahead, slack = (measured, 0.0) if self.holds else (measured + self._lead(period_s), self._slack)
        near = np.clip(np.clip(self.command, ahead - slack, ahead + slack), self._lower, self._upper)
        reach = self._fastest * period_s
        self.command = self.command + np.clip(near - self.command, -reach, reach)

    def _update_velocity(self, measured: FloatArray, period_s: float) -> None:
        """Update the velocities. A joint that is not measured now or was not measured in the previous cycle counts as
        at rest."""
        moved = np.full_like(measured, np.nan) if self._last is None else measured - self._last
        self._velocity += (np.nan_to_num(moved) / period_s - self._velocity) * min(1.0, period_s / SMOOTHED_S)
        self._last = measured

    def _lead(self, period_s: float) -> FloatArray:
        """Return the distances (n,) that the joints will move before their servos act on the new set points.

        Without this lead, the set points would hold the joints back.
        """
        velocity = np.clip(self._velocity, -self._led, self._led)
        lag_s, profile_acceleration, _ = self._lags
        lead: FloatArray = velocity * (lag_s + period_s) + velocity * np.abs(velocity) / (2.0 * profile_acceleration)
        return lead
