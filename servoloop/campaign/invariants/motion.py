"""Invariant on the motion of the simulated arm, independent of its commands."""

import math
from collections import deque
from collections.abc import Callable
from operator import gt, sub
from typing import Final

from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from hal.joint import Joint
from hal.types import JointState
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
        self._excused = 0
        self._happened = 0
        """Number of faults that have started or ended so far."""
        self._positions = deque[list[float]](maxlen=OVER_STEPS + 1)

    def on_step(self, time_s: float) -> None:
        now: list[float] = self.stack.world.position().tolist()
        self._positions.append(now)
        self._excused -= 1
        player = self.stack.player
        if player.active or len(player.happened) > self._happened:
            events = (*player.active.values(), *player.happened[self._happened :])
            self._happened = len(player.happened)
            if any(one.kind in NOT_ITS_OWN for one in events):
                self._excused = AFTER_STEPS
        # For six numbers every millisecond, map is faster than NumPy or a loop.
        if self._excused > 0 or not any(map(gt, map(abs, map(sub, now, self._positions[0])), self._furthest)):
            return
        for joint, here, there, furthest in zip(
            self.stack.world.joints, now, self._positions[0], self._furthest, strict=True
        ):
            if abs(here - there) > furthest and self.active and self.torque(self._by_name[joint]):
                limit = f"but its limit is {self._by_name[joint].limits.velocity:g} rad/s"
                self.say(f"{joint} turned by {abs(here - there):.3f} rad in {OVER_STEPS} ms, {limit}")

    def on_state(self, state: JointState) -> None:
        if not self.active:  # The joints are not driven, so they may fall or be moved by hand.
            self._positions.clear()
        self.examined += len(self._positions) > OVER_STEPS and self._excused <= 0


def _furthest(joint: Joint, within_s: float) -> float:
    """Return the maximum distance (rad or m) that a joint may move within a time."""
    lag_s = max(LAG_S, joint.compliance.lag_s) if joint.compliance else LAG_S
    return joint.limits.velocity * (within_s + lag_s) + OVERSHOOT_RAD
