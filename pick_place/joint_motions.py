"""Steps of a job that moves to joint positions, one goal after another. The module does not import ROS packages."""

from collections.abc import Collection, Sequence

from pick_place.job import JobArm, JobHand, JobMove, JobOutcome, JobPhase, Run
from pick_place.settings import JobSettings


class JointMotions:
    """Motions of ``motion: joints``. Each step is a single goal for the arm or a single command for the fingers."""

    def __init__(self, settings: JobSettings, arm: JobArm) -> None:
        self._settings = settings
        self._arm = arm

    @property
    def grades(self) -> Collection[str]:
        """Grades that have a bin."""
        return self._settings.bins_rad

    def steps(self, grade: str) -> Sequence[JobMove | JobHand]:
        """Return all steps of a job for a known grade."""
        settings = self._settings
        return (
            JobMove(JobPhase.READY, "the ready pose", self._move(settings.ready_rad)),
            JobHand(JobPhase.OPEN_GRIPPER, "opening the gripper", self._hand(settings.hand_open_m)),
            JobMove(JobPhase.GRASP, "the pick pose", self._move(settings.pick_rad)),
            JobHand(JobPhase.CLOSE_GRIPPER, "closing the gripper", self._hand(settings.hand_closed_m)),
            JobMove(JobPhase.PLACE, f"bin {grade}", self._move(settings.bins_rad[grade])),
            JobHand(JobPhase.RELEASE, "opening the gripper", self._hand(settings.hand_open_m)),
            JobMove(JobPhase.DONE, "the ready pose", self._move(settings.ready_rad)),
        )

    def stop(self) -> None:
        """Stop the running motion soon, leaving the arm at its current position."""
        self._arm.stop()

    def _move(self, positions_rad: Sequence[float]) -> Run:
        return lambda: self._arm.move(positions_rad)

    def _hand(self, position_m: float) -> Run:
        async def run() -> JobOutcome:
            self._arm.hand(position_m)
            return JobOutcome(True)

        return run
