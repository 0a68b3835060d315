"""Steps of a job whose motions are planned to tool poses. The module imports no ROS package.

The planner finds a path to a pose above the pick pose or the bin. From there, the tool moves straight down and back up.
"""

from collections.abc import Collection, Sequence
from typing import Protocol

from pick_place.job import JobHand, JobMove, JobOutcome, JobPhase, Run
from pick_place.pose_settings import PoseSettings, ToolPose, above


class JobPlanner(Protocol):
    """Interface through which a job plans and executes its motions. Failures are returned, never raised."""

    async def move(self, positions_rad: Sequence[float]) -> JobOutcome:
        """Plan a motion to joint positions and execute it."""
        ...

    async def move_to(self, pose: ToolPose) -> JobOutcome:
        """Plan a motion of the tool to a pose and execute it."""
        ...

    async def move_straight(self, pose: ToolPose) -> JobOutcome:
        """Move the tool to a pose in a straight line."""
        ...

    async def hand(self, position_m: float) -> JobOutcome:
        """Send a finger position, and give the fingers time to reach it."""
        ...

    async def lay_object(self) -> JobOutcome:
        """Add the object to the scene at its position before picking."""
        ...

    async def attach_object(self) -> JobOutcome:
        """Attach the object to the tool at the object's position in the gripper at the pick pose."""
        ...

    async def remove_object(self) -> JobOutcome:
        """Remove the object from the tool and from the scene. It is not an error if the object does not exist."""
        ...

    async def drop_object(self) -> JobOutcome:
        """Remove the object if it is attached to the tool. Otherwise, leave the scene unchanged."""
        ...

    def stop(self) -> None:
        """Stop the running call soon, leaving the arm at its current position."""
        ...


class PoseMotions:
    """Motions of ``motion: poses``, for one job."""

    def __init__(self, settings: PoseSettings, planner: JobPlanner) -> None:
        self._settings = settings
        self._planner = planner
        self._stopped = False

    @property
    def grades(self) -> Collection[str]:
        """Grades that have a bin."""
        return self._settings.bins

    def steps(self, grade: str) -> Sequence[JobMove | JobHand]:
        """Return all steps of a job for a known grade.

        The object is an obstacle until the tool is above it. The object is then removed from the scene, so that the
        fingers can close around it. Afterwards, the object is attached to the tool until the fingers open again.
        """
        settings, planner = self._settings, self._planner
        pick, bin_pose = settings.pick, settings.bins[grade]
        before_pick, before_bin = above(pick, settings.approach_m), above(bin_pose, settings.approach_m)
        to_ready = self._move(settings.ready_rad)
        lift, lower = self._straight(before_pick), self._straight(bin_pose)
        grasp = (planner.lay_object, self._free(before_pick), planner.remove_object, self._straight(pick))
        return (
            JobMove(JobPhase.READY, "the ready pose", self._all(planner.drop_object, to_ready)),
            JobHand(JobPhase.OPEN_GRIPPER, "opening the gripper", self._all(self._hand(settings.hand_open_m))),
            JobMove(JobPhase.GRASP, "the pick pose", self._all(*grasp)),
            JobHand(
                JobPhase.CLOSE_GRIPPER,
                "closing the gripper",
                self._all(self._hand(settings.hand_closed_m), planner.attach_object),
            ),
            JobMove(JobPhase.PLACE, f"bin {grade}", self._all(lift, self._free(before_bin), lower)),
            JobHand(
                JobPhase.RELEASE,
                "opening the gripper",
                self._all(self._hand(settings.hand_open_m), planner.remove_object),
            ),
            JobMove(JobPhase.DONE, "the ready pose", self._all(self._straight(before_bin), to_ready)),
        )

    def stop(self) -> None:
        """Stop the running step soon, with the arm at its current position."""
        self._stopped = True
        self._planner.stop()

    def _all(self, *parts: Run) -> Run:
        """Return a step that runs its substeps in order until one fails or the job is stopped."""

        async def run() -> JobOutcome:
            for part in parts:
                outcome = await part()
                if self._stopped or not outcome.reached:
                    return JobOutcome(False, outcome.text)
            return JobOutcome(True)

        return run

    def _move(self, positions_rad: Sequence[float]) -> Run:
        return lambda: self._planner.move(positions_rad)

    def _free(self, pose: ToolPose) -> Run:
        return lambda: self._planner.move_to(pose)

    def _straight(self, pose: ToolPose) -> Run:
        return lambda: self._planner.move_straight(pose)

    def _hand(self, position_m: float) -> Run:
        return lambda: self._planner.hand(position_m)
