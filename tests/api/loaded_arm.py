"""Virtual arm in simulated time whose world a test can change."""

from servoloop import Arm
from servoloop.api.options import ArmOptions
from servoloop.api.simulated_loop import SimulatedLoop

FREE = {"shoulder_pan": 0.0, "shoulder_lift": -1.2, "elbow_flex": 0.5, "wrist_flex": 0.8}
"""Pose in which the shoulder turns without touching the bins."""


class LoadedArm(Arm):
    """SO-101 in a free pose. ``push`` loads a joint."""

    def __init__(self) -> None:
        self.loop = SimulatedLoop(ArmOptions("so101").files(), None, None, 0.0)
        self._use(self.loop.backend, self.loop.close, "so101")
        self._loads: dict[str, float] = {}
        self.move_to(FREE, duration=1.5)

    def push(self, joint: str, effort: float) -> None:
        """Set the external load on a joint, in N m."""
        self.loop.world.load(joint, effort - self._loads.get(joint, 0.0))
        self._loads[joint] = effort
