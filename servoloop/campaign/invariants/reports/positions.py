"""Invariant that compares reported positions with the simulated world."""

import math
from collections.abc import Callable
from typing import Final

import numpy as np

from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from hal.types import FloatArray, JointState
from servoloop.campaign.invariants.invariant import DECEIVING, UNREAD, Invariant
from servoloop.campaign.invariants.reference import ReferenceJoint, read_reference
from servoloop.simulation.faulty_stack import FaultyStack

READING_COUNTS: Final = 4.0
"""Tolerance for the resolution and noise of a servo reading, in counts."""
READING_AGE_S: Final = 0.004
"""Maximum age of a position in a servo's register, in seconds."""
RECENT_S: Final = 0.5
"""Time for which a joint is skipped after a false position, or after a fault report that leaves the stack without a
previous reading to compare, in seconds."""
LEAP_S: Final = 0.1
"""Maximum time between two readings of a joint without a reported fault, in seconds, including the stack's margin."""
SWITCHED_CYCLES: Final = 3
"""Number of cycles after an activation in which a silent joint may be reported at a position that the activation
measured. These are the cycle in which the activation ends, the cycle that measures the joints twice, and the next
cycle."""


class ReportedTruly(Invariant):
    """The reported position of a joint without a fault matches its position in MuJoCo, with the correct sign and scale.

    A joint whose servo cannot be read keeps its last reported position.
    """

    name = "reported truly"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        reference = read_reference(stack.files)
        names = stack.loop.hardware.joints
        self._names = [joint for joint in names if joint in reference]
        self._reference = [reference[joint] for joint in self._names]
        self._reported = [names.index(joint) for joint in self._names]
        self._world = [stack.world.joints.index(joint) for joint in self._names]
        self._slack = [
            READING_COUNTS * abs(joint.units_per_count) + READING_AGE_S * joint.velocity for joint in self._reference
        ]
        self._steps: FloatArray = np.empty((0, len(self._names)))
        """Positions (m, n) after each step since the last cycle, and after the step before it."""
        self._by_name = {joint.name: joint for joint in self.joints}
        self._reported_s = dict.fromkeys(self._names, -math.inf)
        """Time at which each joint was last reported with a fault."""
        self._before: list[float] = []
        """Positions reported in the previous cycle."""
        self._switched_cycles = 0
        """Number of upcoming cycles in which a position measured by an activation may be reported."""

    def on_write(self, bus: str, data: bytes) -> None:
        if any(one.switching for one in self.stack.loop.hardware.components):
            self._switched_cycles = SWITCHED_CYCLES

    def on_motion(self, positions: FloatArray) -> None:
        self._steps = np.concatenate((self._steps[-1:], positions[:, self._world]))

    def on_state(self, state: JointState) -> None:
        reported = state.position[self._reported].tolist()
        before, self._before = self._before, reported
        if not len(self._steps):
            return
        lowest, highest = self._steps.min(axis=0).tolist(), self._steps.max(axis=0).tolist()
        if state.faults and before and not self._switched_cycles:
            self._keeps_unread(state, before, reported)
        self._switched_cycles, shared = max(self._switched_cycles - 1, 0), self.sharing_id
        for place, name in enumerate(self._names):
            if name in state.faults:
                self._reported_s[name] = state.stamp_s
            if name in state.faults or name in shared or self._believes(name, state.stamp_s):
                continue
            self.examined += 1
            low, high = lowest[place] - self._slack[place], highest[place] + self._slack[place]
            if not low <= reported[place] <= high and self._wrong(self._reference[place], reported[place], low, high):
                self.say(f"{name} is reported at {reported[place]:.4f}, but was between {low:.4f} and {high:.4f}")

    def _keeps_unread(self, state: JointState, before: list[float], reported: list[float]) -> None:
        for name, last, now in zip(self._names, before, reported, strict=True):
            unread = name in state.faults and state.faults[name].kind in UNREAD
            if unread and math.isfinite(last) and now != last:
                self.say(f"{name} is not measured, but its reported position changes from {last:.4f} to {now:.4f}")

    def _believes(self, name: str, now_s: float) -> bool:
        """Return whether the stack may accept a false position of a joint.

        A jump that is not confirmed by a second reading must be reported. The first reading after a fault has no
        previous reading.
        """
        touches, joint = self.stack.touches, self._by_name[name]
        kinds = touches.kinds(name)
        if not self.deceived(name):
            return bool(self.servos[name].on_read)
        if kinds & DECEIVING != {"false_position"}:
            return True
        if touches.since_s(name, {"false_position"}) >= RECENT_S:
            return False
        if kinds != {"false_position"} or now_s - self._reported_s[name] < RECENT_S or not self.torque(joint):
            return True
        reach = LEAP_S * 2.0 * joint.model.no_load_speed_rad_s * abs(joint.transmission) / abs(joint.units_per_count)
        return not self.never_confirmed(name, reach)

    @staticmethod
    def _wrong(joint: ReferenceJoint, reported: float, low: float, high: float) -> bool:
        middle, half = (low + high) / 2.0, (high - low) / 2.0
        return joint.apart(reported, middle) > half
