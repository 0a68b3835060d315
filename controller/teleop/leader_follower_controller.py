"""The leader-follower controller: each joint of a follower arm goes where the same joint of a leader arm is."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import ClassVar, Final

import numpy as np

from controller.interface import indices
from controller.parameters import Parameters
from controller.teleop.ramp_in import SHARE, RampIn
from hal.compensation.servo_compliance import Compliance, lags
from hal.types import FloatArray, JointLimits, JointState

LEAP_RAD_S: Final = 20.0
"""No hand turns a joint as fast; an encoder that errs does."""
FAR_OUTSIDE: Final = 0.05
"""Share of a joint's range beyond its limits beyond which a calibration is wrong: both arms have stops at them."""
FULL_SPEED_S: Final = 1.0
"""So long after it has joined, the follower may go as fast as it can: there is still a little way to make up for."""
SMOOTHED_S: Final = 0.04
"""The time constant of the leader's velocity, by which the servos' lag is made up for."""


class Phase(StrEnum):
    """What the follower does."""

    HOLDING = "holding"
    JOINING = "joining the leader"
    FOLLOWING = "following"


@dataclass(frozen=True, slots=True)
class FollowedJoint:
    """A joint of the follower: it is to be at ``offset + gain * leader`` (rad or m)."""

    joint: str
    leader: str
    limits: JointLimits
    offset: float = 0.0
    gain: float = 1.0
    compliance: Compliance | None = None
    """How far its servo lags; None: it is taken to follow at once."""


def _beyond(one: FollowedJoint, wanted: float) -> str:
    """Why a leader's joint that is far outside the limits is wrong. The text stays while the joint is out there."""
    return (
        f"{one.leader} takes {one.joint} to {wanted:.3f}, outside its limits {one.limits.lower:.3f} to "
        f"{one.limits.upper:.3f}: one of the arms is calibrated wrongly. End teleoperation and run servoloop calibrate"
    )


class LeaderFollowerController:
    """The follower joins its leader slowly, and follows as long as it may and all of the leader is measured.

    Else it holds, from that very cycle on, and joins anew when it may go on.
    """

    kind: ClassVar[str] = "servoloop/LeaderFollowerController"

    def __init__(self, name: str, joints: Sequence[FollowedJoint], hardware_joints: Sequence[str]) -> None:
        """``hardware_joints``: of both arms, in the order of the measurements."""
        self.name = name
        self.parameters = Parameters()
        self.command_interfaces = tuple(f"{one.joint}/position" for one in joints)
        self.state_interfaces = tuple(f"{one.joint}/position" for one in joints)
        self.command: FloatArray = np.full(len(joints), np.nan)
        self.allowed = False
        """Whether the follower may move: another thread sets it, by what a person does."""
        self.phase = Phase.HOLDING
        self.reason = ""
        """Why it holds although it may move."""
        self.joints = tuple(joints)
        self.wanted: FloatArray = np.full(len(joints), np.nan)
        """Where the leader takes the follower's joints, also beyond their limits (n,); NaN if it is not measured."""
        self.beyond: Mapping[str, str] = {}
        """What is wrong with a leader that is far outside the follower's limits, by the follower's joint."""
        self._leader = indices([one.leader for one in joints], hardware_joints)
        self._limits = tuple(one.limits for one in joints)
        self._lower = np.array([one.limits.lower for one in joints])
        self._upper = np.array([one.limits.upper for one in joints])
        self._fastest = np.array([one.limits.velocity for one in joints])
        self._offset = np.array([one.offset for one in joints])
        self._gain = np.array([one.gain for one in joints])
        self._lags = lags([one.compliance for one in joints])
        self._last: FloatArray | None = None
        """Where the leader was in the cycle before."""
        self._velocity = np.zeros(len(joints))
        """Of the target, smoothed."""
        self._ramp: RampIn | None = None
        self._share = SHARE
        """Of each joint's velocity limit, while it follows."""

    def activate(self, state: JointState, command: FloatArray) -> None:
        self.command = command.copy()
        self._hold("")
        self._last = None

    def deactivate(self, reason: str = "") -> None:
        self._hold(reason)

    def settled(self) -> bool:
        return True

    def update(self, state: JointState, now_s: float, period_s: float) -> None:
        leader = state.position[self._leader]
        reason = self._unfit(state, leader, period_s)
        last, self._last = self._last, None if reason else leader
        self.wanted = np.full(len(leader), np.nan) if reason else self._offset + self._gain * leader
        if not reason:
            self._look_for_limits()
        if reason or not self.allowed:
            self._hold(reason)
            return
        target = np.clip(self.wanted, self._lower, self._upper)
        if last is not None:
            velocity = self._gain * (leader - last) / period_s
            self._velocity += (velocity - self._velocity) * min(1.0, period_s / SMOOTHED_S)
        if self.phase is not Phase.FOLLOWING:
            self._join(target, period_s)
        else:
            self._follow(target, period_s)

    def _look_for_limits(self) -> None:
        """Note which joints the leader takes far outside their limits."""
        slack = FAR_OUTSIDE * (self._upper - self._lower)
        far = (self.wanted < self._lower - slack) | (self.wanted > self._upper + slack)
        if not far.any() and not self.beyond:
            return
        places = np.flatnonzero(far).tolist()
        self.beyond = {
            self.joints[i].joint: self.beyond.get(self.joints[i].joint) or _beyond(self.joints[i], self.wanted[i])
            for i in places
        }

    def _unfit(self, state: JointState, leader: FloatArray, period_s: float) -> str:
        """Why the leader cannot be followed in this cycle; empty where it can."""
        for one in self.joints:
            if one.leader in state.faults:
                return state.faults[one.leader].text
        if not np.isfinite(leader).all():
            return "the leader has not been measured yet"
        if self._last is not None:
            leaps = np.abs(leader - self._last) > LEAP_RAD_S * period_s
            if leaps.any():
                return f"{self.joints[int(np.argmax(leaps))].leader} leapt: that was no hand"
        return ""

    def _hold(self, reason: str) -> None:
        self.phase, self.reason, self._ramp = Phase.HOLDING, reason, None
        self._velocity = np.zeros(len(self.joints))

    def _join(self, target: FloatArray, period_s: float) -> None:
        if self._ramp is None:
            self._ramp = RampIn(self.command, self._limits, period_s)
            self.phase, self.reason = Phase.JOINING, ""
        self._ramp.step(target)
        self.command = np.clip(self._ramp.command, self._lower, self._upper)
        if self._ramp.joined(target):
            self.phase, self._ramp, self._share = Phase.FOLLOWING, None, SHARE

    def _follow(self, target: FloatArray, period_s: float) -> None:
        """As fast as the joints may: where the leader will be at the period's end, and when the servos are there."""
        lag_s, profile_acceleration, _ = self._lags
        velocity = np.clip(self._velocity, -self._fastest, self._fastest)
        lead = velocity * (lag_s + period_s) + velocity * np.abs(velocity) / (2.0 * profile_acceleration)
        ahead = np.clip(target + lead, self._lower, self._upper)
        self._share = min(1.0, self._share + period_s / FULL_SPEED_S)
        reach = self._share * self._fastest * period_s
        self.command = self.command + np.clip(ahead - self.command, -reach, reach)
