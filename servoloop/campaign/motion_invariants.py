"""What must hold of the arm's own motion, whatever it was told."""

from collections import deque
from collections.abc import Callable
from typing import Final

import numpy as np

from hal.types import FloatArray, JointState
from servoloop.campaign.invariant import Invariant
from servoloop.simulation.faulty_stack import FaultyStack

OVER_STEPS: Final = 100
"""Milliseconds over which a way is taken: a servo goes to each new goal at its own speed, and waits there."""
LAG_S: Final = 0.03
"""So long a servo may have been behind its goal (hal/compensation/servo_compliance.py), and makes up for it."""
OVERSHOOT_RAD: Final = 0.05
"""So much further it may get where it is to stop (bench.fidelity)."""
NOT_ITS_OWN: Final = ("collision", "dead_encoder", "jammed", "overload", "slipped_horn", "stuck_encoder")
"""Faults with which it is not the goals that say how fast a joint turns."""
AFTER_STEPS: Final = 500
"""Milliseconds in which a joint springs back when it is let go."""


class NoFasterThanAllowed(Invariant):
    """No driven joint gets further in a tenth of a second than its velocity limit and its servo's overshoot allow."""

    name = "no joint too fast"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None]) -> None:
        super().__init__(stack, say)
        self._mine = [joint for joint in self.joints if joint.name in stack.arm.joints]
        self._index = [stack.arm.joints.index(joint.name) for joint in self._mine]
        time_s = OVER_STEPS * 0.001 + stack.loop.period_s + LAG_S  # of the goals that fall into it
        self._furthest = np.array([joint.limits.velocity for joint in self._mine]) * time_s + OVERSHOOT_RAD
        self._excused = 0
        self._ways = deque[FloatArray](maxlen=OVER_STEPS + 1)

    def on_step(self, time_s: float) -> None:
        self._ways.append(self.stack.trace.actual[-1][self._index])
        self._excused -= 1
        if any(one.kind in NOT_ITS_OWN for one in self.stack.player.active.values()):
            self._excused = AFTER_STEPS
        way = np.abs(self._ways[-1] - self._ways[0])
        if self._excused > 0 or (way <= self._furthest).all():
            return
        for place in np.flatnonzero(way > self._furthest):
            joint = self._mine[place]
            if self.active and self.torque(joint):
                limit = f"its limit is {joint.limits.velocity:g} rad/s"
                self.say(f"{joint.name} turned by {way[place]:.3f} rad in {OVER_STEPS} ms; {limit}")

    def on_state(self, state: JointState) -> None:
        if not self.active:  # what falls or is carried is not driven
            self._ways.clear()
