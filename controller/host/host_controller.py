"""Follow the positions that another controller manager sends, and hold the arm when no more messages arrive."""

import logging
import math
from collections import deque
from collections.abc import Collection, Sequence
from enum import StrEnum
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from controller.forward.approach import ROUNDING, Approach
from controller.host.joint_commands import JointCommands
from controller.interface import indices
from controller.parameters import Parameters
from hal.types import AT_LIMIT, FloatArray, JointLimits, JointState, position_interfaces

LOG = logging.getLogger("servoloop.controller")

Flags = NDArray[np.bool_]

MAX_SILENCE_S: Final = 0.2
"""Maximum time without a command while a joint is still moving, and maximum time without a measurement, in seconds."""
NEAR: Final = 0.02
"""Maximum distance at which a first command counts as near the joint, as a fraction of the joint's range. This distance
allows for sag.
"""
SLOW: Final = 0.1
"""Fraction of the velocity limit at which a joint approaches a first command that is not near the joint."""
JOINED: Final = 0.002
"""Distance at which a slow approach ends, as a fraction of the joint's range.

A slowly moving joint can brake within this distance.
"""


class HostPhase(StrEnum):
    """Current activity of the controller."""

    WAITING = "waiting for the first command"
    APPROACHING = "approaching the first command slowly"
    FOLLOWING = "following the commands"
    HOLDING = "holding"


class HostController:
    """Controller of n joints whose commands are sent by another program at its own rate.

    The commands approach the latest message within the velocity and acceleration limits. At the start or after a pause
    in the messages, a joint approaches its first command slowly if the command is not near the measured position.

    The joints brake and hold their positions in three cases: the messages stop while a joint is still moving to its
    goal, the sender disconnects, or a joint is not measured. The joints start to follow again with the next message.

    NaN in a message means that none of the sender's controllers commands the joint. A joint that is missing from a
    message is treated in the same way as a joint with NaN.
    """

    kind: ClassVar[str] = "servoloop/HostController"

    def __init__(
        self,
        name: str,
        joints: Sequence[str],
        limits: Sequence[JointLimits],
        hardware_joints: Sequence[str],
        others: Collection[str] = (),
    ) -> None:
        """Create a controller.

        Args:
            name: Name of the controller.
            joints: Names of the joints.
            limits: Limits in the order of ``joints``.
            hardware_joints: All measured joints, in the order of the measurements.
            others: Joints of the robot that cannot be commanded. Messages may contain these joints.
        """
        self.name = name
        self.parameters = Parameters()
        self.joints = tuple(joints)
        self.command_interfaces = position_interfaces(joints)
        self.state_interfaces = self.command_interfaces
        self.command: FloatArray = np.full(len(joints), np.nan)
        self.reason = ""
        """Reason why the joints hold their positions; empty if they follow the commands."""
        self._messages = JointCommands(joints, others)
        self._inbox: deque[FloatArray] = deque(maxlen=1)
        self._losses: deque[str] = deque(maxlen=1)
        self._at = indices(joints, hardware_joints)
        self._lower = np.array([limit.lower for limit in limits])
        self._upper = np.array([limit.upper for limit in limits])
        spans = self._upper - self._lower
        self._range = np.where(np.isfinite(spans), spans, math.tau)
        """Range (n,) of each joint, or a full turn for a joint without limits."""
        self._approach = Approach(limits)
        self._goal = self.command
        """Goals (n,) within the limits, in rad or m."""
        self._beyond = np.zeros(len(joints), dtype=bool)
        """Whether the last command of each joint was outside the limits."""
        self._followed = np.zeros(len(joints), dtype=bool)
        """Whether each joint is following its commands.

        The other joints hold their positions, and their next command is treated as a first command.
        """
        self._slow = np.zeros(len(joints), dtype=bool)
        """Whether each joint is still approaching its first command."""
        self._age_s = np.zeros(len(joints))
        """Time since the last command of each joint, in seconds."""
        self._unmeasured_s = np.zeros(len(joints))

    def submit(self, names: Sequence[str], positions: Sequence[float]) -> None:
        """Submit a message. Any thread may call this method.

        Raises RefusedCommandError if the message is not a command for these joints.
        """
        self._inbox.append(self._messages.sorted(names, positions))

    def lose(self, reason: str) -> None:
        """Brake and hold the joints in the next cycle, because the sender has disconnected.

        Any thread may call this method.
        """
        self._losses.append(reason)

    def activate(self, state: JointState, command: FloatArray) -> None:
        self._inbox.clear()
        self._losses.clear()
        self.command = self._goal = command.copy()
        self._approach.begin(command)
        self._followed[:] = self._slow[:] = self._beyond[:] = False
        self._unmeasured_s[:] = 0.0
        self.reason = ""

    def deactivate(self, reason: str = "") -> None:
        self._inbox.clear()

    def settled(self) -> bool:
        return bool((np.abs(self._goal - self.command) <= ROUNDING).all())

    def update(self, state: JointState, now_s: float, period_s: float) -> None:
        message = self._inbox.popleft() if self._inbox else None
        lost = self._losses.popleft() if self._losses else ""
        if reason := self._unmeasured(state, period_s) or lost:
            self._hold(self._followed, reason, period_s)
        elif message is not None:
            self._take(message, state.position[self._at])
        self._age_s += period_s
        self._hold_if_silent(period_s)
        self.command = self._approach.step(self._goal, period_s, np.where(self._slow, SLOW, 1.0))
        self._slow &= np.abs(self._goal - self.command) > JOINED * self._range

    @property
    def phase(self) -> HostPhase:
        """Current activity. Any thread may read this property."""
        if self._followed.any():
            return HostPhase.APPROACHING if self._slow.any() else HostPhase.FOLLOWING
        return HostPhase.HOLDING if self.reason else HostPhase.WAITING

    def _unmeasured(self, state: JointState, period_s: float) -> str:
        """Return the reason why the joints hold because of missing measurements; an empty string if there is none."""
        if not state.faults:
            self._unmeasured_s[:] = 0.0
            return ""
        silent = np.array([joint in state.faults for joint in self.joints], dtype=bool)
        self._unmeasured_s = np.where(silent, self._unmeasured_s + period_s, 0.0)
        late = np.flatnonzero(self._unmeasured_s > MAX_SILENCE_S)
        return "" if not late.size else state.faults[self.joints[int(late[0])]].text

    def _take(self, message: FloatArray, measured: FloatArray) -> None:
        given = np.isfinite(message)
        if not given.any():
            return
        goal = np.where(given, np.clip(message, self._lower, self._upper), self._goal)
        self._report_limits(message, goal, given)
        silent: Flags = self._followed & (self._age_s > MAX_SILENCE_S)
        first = given & (silent | ~self._followed)
        if first.any():
            self._begin(first, goal, measured)
        self._goal = goal
        self._age_s[given] = 0.0

    def _hold_if_silent(self, period_s: float) -> None:
        """Brake and hold the joints if no command arrives while joints are still moving to their goals.

        It is normal that no commands arrive after the joints have reached their goals.
        """
        ways = np.abs(self._goal - self.command)
        silent: Flags = self._followed & (self._age_s > MAX_SILENCE_S)
        if (silent & (ways > ROUNDING)).any():
            far = int(np.argmax(np.where(silent, ways, 0.0)))
            short = f"{self.joints[far]} was {ways[far]:.3f} short of its command"
            self._hold(silent, f"no command for {MAX_SILENCE_S:g} s while {short}", period_s)

    def _hold(self, which: Flags, reason: str, period_s: float) -> None:
        """Brake some joints and hold them at the positions where they come to rest.

        The next command for these joints is treated as a first command.
        """
        if which.any():
            LOG.warning("%s: the arm brakes and holds its position until the next command", reason)
            self.reason = reason
        self._goal = np.where(which, self._approach.resting_points(period_s), self._goal)
        self._slow &= ~which
        self._followed &= ~which

    def _begin(self, first: Flags, goal: FloatArray, measured: FloatArray) -> None:
        """Begin to follow the commands of some joints, slowly if the commands are far from the measured positions."""
        far = first & (np.abs(goal - measured) > NEAR * self._range)
        self._followed |= first
        self._slow |= far
        self.reason = ""
        if far.any():
            ways = [
                f"{self.joints[i]} by {goal[i] - measured[i]:+.3f} (from {measured[i]:.3f} to {goal[i]:.3f})"
                for i in np.flatnonzero(far).tolist()
            ]
            LOG.warning(
                "the first command would move %s: the arm approaches the command at %d %% of its velocity limits",
                ", ".join(ways),
                round(100 * SLOW),
            )

    def _report_limits(self, message: FloatArray, goal: FloatArray, given: Flags) -> None:
        beyond: Flags = given & (np.abs(message - goal) > AT_LIMIT * self._range)
        for i in np.flatnonzero(beyond & ~self._beyond).tolist():
            LOG.warning(
                "%s: the command %.4f is outside the limits %.4f to %.4f; the joint moves to %.4f instead",
                self.joints[i],
                message[i],
                self._lower[i],
                self._upper[i],
                goal[i],
            )
        self._beyond = beyond
