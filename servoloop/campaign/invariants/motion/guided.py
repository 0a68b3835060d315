"""Invariant on joints that are moved by hand."""

from collections import Counter
from collections.abc import Callable
from typing import Final

import numpy as np

from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from hal.types import JointState
from servoloop.api.freedrive import FREEDRIVE
from servoloop.campaign.invariants.invariant import Invariant
from servoloop.simulation.faulty_stack import FaultyStack

FADES_IN_S: Final = 1.1
"""Time after which the joints of a guided arm must be movable by hand, in seconds."""
HOLDS_SHARE: Final = 0.3
"""Largest fraction of its full drive with which a guided joint resists a hand."""
NEAR: Final = 0.02
"""Additional distance allowed between a guided joint and its command, in rad or m."""
LAG_S: Final = 0.15
"""Distance allowed between a moving joint and its command, as a multiple of the joint's velocity, in seconds."""
HELD_CYCLES: Final = 10
"""Number of cycles for which a joint may be further away, for example while freedrive ends."""


class GuidedJointsYield(Invariant):
    """While the arm is guided by hand, the command of each joint stays close to the position of the joint.

    A joint outside its limits and a joint with a fault are skipped.
    """

    name = "guided joints yield"
    promised = False

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._near = {
            joint.name: HOLDS_SHARE * joint.full_effort / joint.compliance.stiffness + NEAR
            for joint in self.joints
            if joint.compliance is not None and joint.name in arm.joints
        }
        """Distance allowed between each joint of the arm and its command, in rad or m."""
        self._guided_s = 0.0
        self._far_cycles = Counter[str]()

    def on_state(self, state: JointState) -> None:
        loop, freedrive = self.stack.loop, self.stack.manager.registry.loaded.get(FREEDRIVE)
        guided = freedrive is not None and freedrive.active and self.active and not self.stack.ending
        self._guided_s = self._guided_s + loop.period_s if guided else 0.0
        if self._guided_s <= FADES_IN_S:
            self._far_cycles.clear()
            return
        true = self.true_positions()
        speeds = dict(zip(self.stack.world.joints, np.abs(self.stack.world.velocity()).tolist(), strict=True))
        for joint, near in self._near.items():
            limit = loop.limits[self.commanded.index(joint)]
            excused = joint in state.faults or self.deceived(joint) or self.stack.touches.since_s(joint) < FADES_IN_S
            if excused or not limit.lower <= true[joint] <= limit.upper:
                self._far_cycles[joint] = 0
                continue
            self.examined += 1
            far = self.off_command(joint, true[joint]) > near + LAG_S * speeds[joint]
            self._far_cycles[joint] = self._far_cycles[joint] + 1 if far else 0
            if self._far_cycles[joint] > HELD_CYCLES:
                command = loop.command[self.commanded.index(joint)]
                self.say(f"{joint} is guided by hand to {true[joint]:.3f}, but its command stays at {command:.3f}")
