"""Move each joint of a follower arm to the position of the corresponding joint of a leader arm."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import ClassVar, Final

import numpy as np

from controller.interface import indices
from controller.parameters import Parameters
from controller.teleop.ramp_in import SHARE, RampIn
from hal.compensation.servo_compliance import Compliance, lags
from hal.types import FloatArray, JointLimits, JointState, position_interfaces

LEAP_RAD_S: Final = 20.0
"""Maximum plausible speed of the leader, in rad/s. A joint cannot be turned faster by hand, so a higher speed indicates
an error."""
FAR_OUTSIDE: Final = 0.05
"""Maximum distance beyond a limit, as a fraction of the joint's range.

Both arms have mechanical stops at their limits, so a larger distance indicates a wrong calibration.
"""
FULL_SPEED_S: Final = 1.0
"""Time in which the follower's speed limit rises to its maximum after joining the leader, in seconds."""
SMOOTHED_S: Final = 0.04
"""Time constant of the filter for the leader's velocity, in seconds. The filtered velocity is used to compensate for
servo lag."""


class FollowerPhase(StrEnum):
    """Current activity of the follower."""

    HOLDING = "holding"
    JOINING = "joining the leader"
    FOLLOWING = "following"


@dataclass(frozen=True, slots=True)
class FollowedJoint:
    """A joint of the follower. The joint's target is ``offset + gain * leader``, in rad or m."""

    joint: str
    leader: str
    limits: JointLimits
    offset: float = 0.0
    gain: float = 1.0
    compliance: Compliance | None = None
    """Compliance and lag of the servo. None means that the servo follows at once."""


def _beyond(followed: FollowedJoint, wanted: float) -> str:
    """Return the error message for a leader joint that is far outside the follower's limits."""
    lower, upper = followed.limits.lower, followed.limits.upper
    return (
        f"{followed.leader} would move {followed.joint} to {wanted:.3f}, outside its limits {lower:.3f} to "
        f"{upper:.3f}: one of the arms is calibrated wrongly. End teleoperation and run servoloop calibrate"
    )


class LeaderFollowerController:
    """Controller for a follower arm.

    The follower joins its leader slowly and then follows the leader's motion. The follower holds its position in every
    cycle in which motion is not allowed or a leader joint is not measured. After such a cycle, the follower joins the
    leader again.
    """

    kind: ClassVar[str] = "servoloop/LeaderFollowerController"

    def __init__(self, name: str, joints: Sequence[FollowedJoint], hardware_joints: Sequence[str]) -> None:
        """Create a controller. ``hardware_joints`` are the joints of both arms, in measurement order."""
        self.name = name
        self.parameters = Parameters()
        self.command_interfaces = position_interfaces(followed.joint for followed in joints)
        self.state_interfaces = self.command_interfaces
        self.command: FloatArray = np.full(len(joints), np.nan)
        self.allowed = False
        """Whether the follower is allowed to move. Another thread sets this flag when the operator allows motion."""
        self.phase = FollowerPhase.HOLDING
        self.reason = ""
        """Reason why the follower holds its position although it is allowed to move."""
        self.joints = tuple(joints)
        self.wanted: FloatArray = np.full(len(joints), np.nan)
        """Positions (n,) requested by the leader, before the limits are applied. The positions are NaN if the leader is
        not measured."""
        self.beyond: Mapping[str, str] = {}
        """Errors for joints that the leader would move far outside their limits, keyed by the follower's joint name."""
        self._leader = indices([followed.leader for followed in joints], hardware_joints)
        self._limits = tuple(followed.limits for followed in joints)
        self._lower = np.array([followed.limits.lower for followed in joints])
        self._upper = np.array([followed.limits.upper for followed in joints])
        self._fastest = np.array([followed.limits.velocity for followed in joints])
        self._offset = np.array([followed.offset for followed in joints])
        self._gain = np.array([followed.gain for followed in joints])
        self._lags = lags([followed.compliance for followed in joints])
        self._last: FloatArray | None = None
        """Position of the leader in the previous cycle."""
        self._velocity = np.zeros(len(joints))
        """Smoothed velocity of the target."""
        self._ramp: RampIn | None = None
        self._share = SHARE
        """Fraction of each joint's velocity limit that the follower may use."""

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
            self._check_limits()
        if reason or not self.allowed:
            self._hold(reason)
            return
        target = np.clip(self.wanted, self._lower, self._upper)
        if last is not None:
            velocity = self._gain * (leader - last) / period_s
            self._velocity += (velocity - self._velocity) * min(1.0, period_s / SMOOTHED_S)
        if self.phase is not FollowerPhase.FOLLOWING:
            self._join(target, period_s)
        else:
            self._follow(target, period_s)

    def _check_limits(self) -> None:
        """Record which joints would be moved far outside their limits by the leader."""
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
        """Return the reason why the leader cannot be followed in this cycle; an empty string if it can."""
        for followed in self.joints:
            if followed.leader in state.faults:
                return state.faults[followed.leader].text
        if not np.isfinite(leader).all():
            return "the leader has not been measured yet"
        if self._last is not None:
            leaps = np.abs(leader - self._last) > LEAP_RAD_S * period_s
            if leaps.any():
                return f"{self.joints[int(np.argmax(leaps))].leader} moved faster than a hand can move a joint"
        return ""

    def _hold(self, reason: str) -> None:
        self.phase, self.reason, self._ramp = FollowerPhase.HOLDING, reason, None
        self._velocity = np.zeros(len(self.joints))

    def _join(self, target: FloatArray, period_s: float) -> None:
        if self._ramp is None:
            self._ramp = RampIn(self.command, self._limits, period_s)
            self.phase, self.reason = FollowerPhase.JOINING, ""
        self._ramp.step(target)
        self.command = np.clip(self._ramp.command, self._lower, self._upper)
        if self._ramp.joined(target):
            self.phase, self._ramp, self._share = FollowerPhase.FOLLOWING, None, SHARE

    def _follow(self, target: FloatArray, period_s: float) -> None:
        """Follow the leader within the speed limit.

        The command leads the leader's position by one period plus the servo lag.
        """
        lag_s, profile_acceleration, _ = self._lags
        velocity = np.clip(self._velocity, -self._fastest, self._fastest)
        lead = velocity * (lag_s + period_s) + velocity * np.abs(velocity) / (2.0 * profile_acceleration)
        ahead = np.clip(target + lead, self._lower, self._upper)
        self._share = min(1.0, self._share + period_s / FULL_SPEED_S)
        reach = self._share * self._fastest * period_s
        self.command = self.command + np.clip(ahead - self.command, -reach, reach)
