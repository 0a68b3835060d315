"""What must hold of the arm's own motion, whatever it was told."""

import math
from collections import deque
from collections.abc import Callable
from operator import gt, sub
from typing import Final

from hal.joint import Joint
from hal.types import JointState
from servoloop.campaign.invariants.invariant import Invariant
from servoloop.simulation.faulty_stack import FaultyStack

OVER_STEPS: Final = 100
"""Milliseconds over which a way is taken: a servo goes to each new goal at its own speed, and waits there."""
LAG_S: Final = 0.03
"""Least time by which a servo may have been behind its goal, and makes up for it; a soft one lags by more
(hal/compensation/servo_compliance.py)."""
OVERSHOOT_RAD: Final = 0.05
"""So much further it may get where it is to stop (benchmarks.fidelity)."""
NOT_ITS_OWN: Final = ("collision", "dead_encoder", "jammed", "overload", "slipped_horn", "stuck_encoder")
"""Faults with which it is not the goals that say how fast a joint turns."""
AFTER_STEPS: Final = 500
"""Milliseconds in which a joint springs back when it is let go."""


class NoFasterThanAllowed(Invariant):
    """No driven joint gets further in a tenth of a second than its velocity limit and its servo's overshoot allow."""

    name = "no joint too fast"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None]) -> None:
        super().__init__(stack, say)
        self._mine = {joint.name: joint for joint in self.joints}
        within_s = OVER_STEPS * 0.001 + stack.loop.period_s  # of the goals that fall into it
        self._furthest = [
            _furthest(self._mine[name], within_s) if name in self._mine else math.inf for name in stack.world.joints
        ]
        self._excused = 0
        self._ways = deque[list[float]](maxlen=OVER_STEPS + 1)

    def on_step(self, time_s: float) -> None:
        now: list[float] = self.stack.world.position().tolist()
        self._ways.append(now)
        self._excused -= 1
        active = self.stack.player.active
        if active and any(one.kind in NOT_ITS_OWN for one in active.values()):
            self._excused = AFTER_STEPS
        # Six numbers every millisecond: NumPy would take longer, and so would a loop.
        if self._excused > 0 or not any(map(gt, map(abs, map(sub, now, self._ways[0])), self._furthest)):
            return
        for joint, here, there, furthest in zip(
            self.stack.world.joints, now, self._ways[0], self._furthest, strict=True
        ):
            if abs(here - there) > furthest and self.active and self.torque(self._mine[joint]):
                limit = f"its limit is {self._mine[joint].limits.velocity:g} rad/s"
                self.say(f"{joint} turned by {abs(here - there):.3f} rad in {OVER_STEPS} ms; {limit}")

    def on_state(self, state: JointState) -> None:
        if not self.active:  # what falls or is carried is not driven
            self._ways.clear()
        self.examined += len(self._ways) > OVER_STEPS and self._excused <= 0


def _furthest(joint: Joint, within_s: float) -> float:
    """The distance (rad or m) that a joint may get in this time."""
    lag_s = max(LAG_S, joint.compliance.lag_s) if joint.compliance else LAG_S
    return joint.limits.velocity * (within_s + lag_s) + OVERSHOOT_RAD
