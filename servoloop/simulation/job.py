"""Run the job of the pick-and-place node on a simulated stack without ROS.

The steps, poses and messages are the same as in the pick-and-place node.
"""

from collections.abc import Collection, Generator, Sequence
from dataclasses import dataclass
from typing import cast

from controller.action_goals import GoalStatus
from controller.forward.forward_command_controller import ForwardCommandController
from controller.trajectory.goal import GoalHandle, GoalPoint, TrajectoryGoal
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from pick_place.job import JobEnding, JobOutcome, PickPlaceJob, Result, State
from pick_place.joint_motions import JointMotions
from pick_place.settings import JobSettings
from servoloop.recording.following_error import FollowingError
from servoloop.simulation.stack import SimulatedStack
from servoloop.stack.arm_folders import ArmFolder
from servoloop.stack.pick_place import arm_jobs
from servoloop.stack.robot_files import Files
from sim_backend.scene.scene_check import require_scene

LONGEST_S = 60.0
"""Maximum duration of a job, in seconds. The longest wait within a job is 4 s, for the hand."""
FALLS_S = 1.0
"""Maximum time for a released cube to come to rest, in seconds."""


class _NextCycle:
    """Awaitable that completes in the next cycle of the loop."""

    def __await__(self) -> Generator[None, None, None]:
        yield


class SimulatedArm:
    """Implementation of pick_place.job.JobArm with the controllers of a simulated stack."""

    def __init__(self, stack: SimulatedStack, settings: JobSettings) -> None:
        arm, hand = (stack.controller(name) for name in (settings.arm_controller, settings.hand_controller))
        self._arm = stack.arm if arm is None else cast(JointTrajectoryController, arm)
        self._hand = stack.hand if hand is None else cast(ForwardCommandController, hand)
        self._settings = settings
        self._goal: GoalHandle | None = None

    def hand(self, position_m: float) -> None:
        self._hand.submit([position_m])

    def stop(self) -> None:
        if self._goal is not None:
            self._arm.cancel(self._goal)

    async def move(self, positions_rad: Sequence[float]) -> JobOutcome:
        point = GoalPoint(tuple(positions_rad), self._settings.move_time_s)
        goal = TrajectoryGoal(self._settings.joints, (point,))
        if reason := self._arm.check(goal):
            return JobOutcome(False, f"the arm rejected the goal: {reason}")
        handle = self._goal = self._arm.submit(goal)
        while not handle.done:
            await _NextCycle()
        if handle.status is GoalStatus.SUCCEEDED:
            return JobOutcome(True)
        return JobOutcome(False, f"the arm {handle.status.name.lower()}: {handle.error_text}")


@dataclass(frozen=True, slots=True)
class JobRecord:
    """Record of one job, with times in simulated seconds."""

    arm: str
    """Name of the arm, such as ``left``; empty if there is only one arm."""
    grade: str
    success: bool
    """Whether the job succeeded and the cube landed in the correct bin."""
    bin: str | None
    message: str
    duration_s: float
    joints: tuple[str, ...]
    """Joints of the arm, in the order of the following error."""
    following: FollowingError
    states: tuple[State, ...]


def require_cell(files: Files, grades: Collection[str]) -> None:
    """Raise ArmFileError if jobs are planned but the scene lacks the cube, the stand or a bin."""
    if grades:
        require_scene(files.scene, [joint.name for joint in files.robot.joints], cell=True)


def job_settings(arm: ArmFolder, grades: Collection[str]) -> dict[str, JobSettings]:
    """Return the settings of each arm's pick-and-place node, keyed by arm name; the key of a single arm is "".

    If there are no jobs, return an empty mapping without reading any file. Raises ArmFileError.
    """
    return {name: job.settings() for name, job in arm_jobs(arm.pick_place).items()} if grades else {}


class RunningJob:
    """One job of one arm. Call ``after_cycle`` after every cycle until the cube has come to rest, then ``close``."""

    def __init__(
        self, stack: SimulatedStack, settings: JobSettings, grade: str, number: int = 1, arm: str = ""
    ) -> None:
        self._stack, self._settings, self._number, self._arm = stack, settings, number, arm
        self._states: list[State] = []
        motions = JointMotions(settings, SimulatedArm(stack, settings))
        self._job = PickPlaceJob(number, grade, motions, self._states.append)
        self._steps = self._job.run()
        self._results: list[Result] = []
        self._bins: list[str] = []
        self._begun_s = stack.clock.now()

    @property
    def done(self) -> bool:
        """Whether the job has finished."""
        return bool(self._results)

    def after_cycle(self) -> None:
        """Advance the job, and check where the cube is."""
        if not self._results:
            try:
                self._steps.send(None)
            except StopIteration as end:
                self._results.append(end.value)
        if found := self._stack.world.cube_bin(self._settings.joints[0]):
            self._bins.append(found)

    def close(self) -> None:
        """Abandon the job if it has not finished."""
        self._steps.close()

    def record(self, ended_s: float) -> JobRecord:
        """Return the record of the job, which finished at ``ended_s`` on the stack's clock."""
        no_end = Result(JobEnding.ABORTED, self._number, f"the job did not finish within {LONGEST_S:g} s")
        result = self._results[0] if self._results else no_end
        landed = self._bins[-1] if self._bins else None
        return JobRecord(
            self._arm,
            self._job.grade,
            result.ending is JobEnding.SUCCEEDED and landed == self._job.grade,
            landed,
            result.message,
            ended_s - self._begun_s,
            tuple(self._settings.joints),
            self._stack.trace_of(self._settings.joints).following(since_s=self._begun_s),
            tuple(self._states),
        )


def run_job(stack: SimulatedStack, settings: JobSettings, grade: str, number: int = 1) -> JobRecord:
    """Run one job until the cube has come to rest. Raises the stack's errors, such as PortLost."""
    job = RunningJob(stack, settings, grade, number)
    stack.after_cycle = job.after_cycle
    try:
        stack.run(LONGEST_S, lambda: job.done)
        ended_s = stack.clock.now()
        stack.run(FALLS_S)
    finally:
        job.close()
        stack.after_cycle = lambda: None
    return job.record(ended_s)
