"""Invariant on the motion of the simulated arm, independent of its commands."""

import math
from collections import Counter
from collections.abc import Callable
from typing import Final

import numpy as np

from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from hal.joint import Joint
from hal.types import FloatArray, JointState
from servoloop.campaign.invariants.invariant import Invariant
from servoloop.simulation.faulty_stack import FaultyStack

OVER_STEPS: Final = 100
"""Time over which a distance is measured, in ms. A servo moves to each goal at its own speed and waits there for the
next one."""
LAG_S: Final = 0.03
"""Time by which a servo may lag behind its goal before it catches up, in seconds. Soft servos lag further behind
(hal/compensation/servo_compliance.py)."""
OVERSHOOT_RAD: Final = 0.1
"""Overshoot of a joint that stops (0.05 in benchmarks.fidelity) or is freed from an obstacle at full drive, in rad."""
NOT_ITS_OWN: Final = ("collision", "dead_encoder", "jammed", "overload", "slipped_horn", "stuck_encoder")
"""Faults during which the goals do not determine the speed of a joint."""
PUSHED: Final = 0.5
"""Minimum following error at which a joint counts as pushed, in rad or m."""
PUSHED_CYCLES: Final = 5
"""Minimum number of cycles for which a joint must be far from its command to count as pushed."""
SPRINGS_BACK_S: Final = 0.2
"""Time after a pushed joint is free during which its speed is not checked, in seconds."""
AFTER_STEPS: Final = 500
"""Maximum time until a joint has sprung back after one of the faults in ``NOT_ITS_OWN``, in ms."""


class NoFasterThanAllowed(Invariant):
    """No driven joint moves further in a tenth of a second than its velocity limit, servo lag and overshoot allow."""

    name = "no joint too fast"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._by_name = {joint.name: joint for joint in self.joints}
        within_s = OVER_STEPS * 0.001 + stack.loop.period_s  # The first goal is up to one period old.
        self._furthest = [
            _furthest(self._by_name[name], within_s) if name in self._by_name else math.inf
            for name in stack.world.joints
        ]
        self._excused_steps = 0
        """Remaining time for which the speed is not checked, in ms."""
        self._happened = 0
        """Number of faults that have started or ended so far."""
        self._pushed_cycles = Counter[str]()
        """Number of consecutive cycles in which each joint was far from its command."""
        self._pushed_s: dict[str, float] = {}
        """Time of the latest cycle in which each joint had been far from its command for some time."""
        self._steps: FloatArray = np.empty((0, len(stack.world.joints)))
        """Positions (m, n) after each step since the last cycle, and after the ``OVER_STEPS`` steps before it."""

    def on_motion(self, positions: FloatArray) -> None:
        self._excused_steps -= len(positions)
        self._steps = np.concatenate((self._steps, positions))

    def on_state(self, state: JointState) -> None:
        if self._is_moved_by_fault():
            self._excused_steps = AFTER_STEPS
        self._note_pushed()
        if not self.active:  # The joints are not driven, so they may fall or be moved by hand.
            self._steps = self._steps[:0]
        if len(self._steps) > OVER_STEPS and self._excused_steps <= 0:
            self.examined += 1
            self._check()
        self._steps = self._steps[-OVER_STEPS:]

    def _is_moved_by_fault(self) -> bool:
        """Return whether one of the faults in ``NOT_ITS_OWN`` has been active since the last cycle."""
        player = self.stack.player
        events = (*player.active.values(), *player.happened[self._happened :])
        self._happened = len(player.happened)
        return any(one.kind in NOT_ITS_OWN for one in events)

    def _note_pushed(self) -> None:
        """Note the joints that have been pushed far from their commands. These joints spring back when they are
        free."""
        true = self.true_positions()
        for joint in self._by_name:
            far = self.off_command(joint, true[joint]) > PUSHED
            self._pushed_cycles[joint] = self._pushed_cycles[joint] + 1 if far else 0
            if self._pushed_cycles[joint] >= PUSHED_CYCLES:
                self._pushed_s[joint] = self.stack.clock.now()

    def _check(self) -> None:
        """Check the distances to the positions ``OVER_STEPS`` steps earlier, for all steps of a cycle at once."""
        moved = np.abs(self._steps[OVER_STEPS:] - self._steps[:-OVER_STEPS]).max(axis=0)
        for index in np.flatnonzero(moved > self._furthest):
            joint = self._by_name[self.stack.world.joints[index]]
            springs_back = self.stack.clock.now() - self._pushed_s.get(joint.name, -math.inf) < SPRINGS_BACK_S
            if self.torque(joint) and not springs_back:
                limit = f"but its limit is {joint.limits.velocity:g} rad/s"
                self.say(f"{joint.name} turned by {moved[index]:.3f} rad in {OVER_STEPS} ms, {limit}")


def _furthest(joint: Joint, within_s: float) -> float:
    """Return the maximum distance (rad or m) that a joint may move within a time."""
    lag_s = max(LAG_S, joint.compliance.lag_s) if joint.compliance else LAG_S
    return joint.limits.velocity * (within_s + lag_s) + OVERSHOOT_RAD
