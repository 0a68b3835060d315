"""Run the job of the pick-and-place node on a simulated stack without ROS.

The steps, poses and messages are those of the node.
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
from servoloop.stack.pick_place import load_pick_place
from servoloop.stack.robot_files import Files
from sim_backend.scene.scene_check import require_scene

LONGEST_S = 60.0
"""Maximum duration of a job, in seconds. Its longest wait is 4 s, for the hand."""
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
    """Record of one job, with times in seconds of the simulation."""

    grade: str
    success: bool
    """Whether the job succeeded and the cube landed in its bin."""
    bin: str | None
    message: str
    duration_s: float
    following: FollowingError
    states: tuple[State, ...]


def require_cell(files: Files, grades: Collection[str]) -> None:
    """If there are jobs, raise ArmFileError unless the scene has the cube, the stand and the bins."""
    if grades:
        require_scene(files.scene, [joint.name for joint in files.robot.joints], cell=True)


def job_settings(arm: ArmFolder, grades: Collection[str]) -> JobSettings:
    """Return the settings of the arm's pick-and-place node. Without jobs, return the defaults without reading a file.

    Raises ArmFileError.
    """
    return load_pick_place(arm.pick_place).settings() if grades else JobSettings()


def run_job(stack: SimulatedStack, settings: JobSettings, grade: str, number: int = 1) -> JobRecord:
    """Run one job until the cube has come to rest. Raises the errors of the stack, such as PortLost."""
    begun_s = stack.clock.now()
    states: list[State] = []
    job = PickPlaceJob(number, grade, JointMotions(settings, SimulatedArm(stack, settings)), states.append)
    steps, results, bins = job.run(), list[Result](), list[str]()

    def after_cycle() -> None:
        if not results:
            try:
                steps.send(None)
            except StopIteration as end:
                results.append(end.value)
        if found := stack.world.cube_bin(settings.joints[0]):
            bins.append(found)

    stack.after_cycle = after_cycle
    try:
        stack.run(LONGEST_S, lambda: bool(results))
        duration_s = stack.clock.now() - begun_s
        stack.run(FALLS_S)
    finally:
        steps.close()
        stack.after_cycle = lambda: None
    result = results[0] if results else Result(JobEnding.ABORTED, number, f"no end within {LONGEST_S:g} s")
    landed = bins[-1] if bins else None
    return JobRecord(
        job.grade,
        result.ending is JobEnding.SUCCEEDED and landed == job.grade,
        landed,
        result.message,
        duration_s,
        stack.trace.following(since_s=begun_s),
        tuple(states),
    )
