"""Poses of the pick-and-place job, and the job as another node might send it, without waiting for the hand."""

from controller.action_goals import GoalStatus
from controller.trajectory.goal import GoalHandle
from pick_place.settings import JobSettings
from servoloop.simulation.stack import SimulatedStack

ARM = tuple(f"joint{i}" for i in range(1, 7))
READY = (0.0, -0.3643, -0.6419, -0.8154, -0.9541, -1.6828)
PICK = (0.0, -0.35, -0.70, -0.70, -1.10, 1.55)
BINS = {
    "A": (0.4, -0.2, -0.8, -0.6, -1.1, 1.55),
    "B": (0.0, -0.2, -0.8, -0.6, -1.1, 1.55),
    "C": (-0.4, -0.2, -0.8, -0.6, -1.1, 1.55),
}
OPEN_M, CLOSED_M = 0.0, 0.05
ROBOT_ARM = JobSettings()


class UnpacedJob:
    """Pick-and-place job that sends the arm goal immediately after the hand command."""

    def __init__(self, rig: SimulatedStack, grade: str, settings: JobSettings = ROBOT_ARM) -> None:
        self._rig, self._grade = rig, grade
        self._steps = [
            (None, settings.ready_rad),
            (settings.hand_open_m, settings.pick_rad),
            (settings.hand_closed_m, settings.bins_rad[grade]),
            (settings.hand_open_m, settings.ready_rad),
        ]
        self.handles: list[GoalHandle] = []

    @property
    def done(self) -> bool:
        return not self._steps and self.handles[-1].done

    def react(self) -> None:
        """Send the next goal as soon as the previous goal has ended. Called after each cycle."""
        if self._steps and (not self.handles or self.handles[-1].done):
            hand_m, pose = self._steps.pop(0)
            if hand_m is not None:
                assert self._rig.hand.submit([hand_m]) is None
            self.handles.append(self._rig.go(pose))

    def check(self) -> None:
        """Check that every goal has succeeded and that the cube lies in the bin of its grade."""
        assert [handle.status for handle in self.handles] == [GoalStatus.SUCCEEDED] * 4
        assert self._rig.world.cube_bin() == self._grade

    def run(self, longest_s: float = 20.0) -> None:
        """Run the whole job."""
        self._rig.after_cycle = self.react
        self._rig.run(longest_s, lambda: self.done)
        self._rig.after_cycle = lambda: None
