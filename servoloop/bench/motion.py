"""Slow motions of ``servoloop bench arm``, with the control loop and the trajectory controller but without ROS."""

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

from commissioning.slow_arm import SPEED_SHARE
from controller.action_goals import GoalStatus
from controller.loop import ControlLoop
from controller.trajectory.goal import GoalPoint, TrajectoryGoal
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from drivers.clock import Clock
from drivers.driver_errors import DriverError
from hal.robot_file.robot_file import ExitFile, ParkFile
from hal.types import FloatArray, JointLimits
from servoloop.bench.figures import Distribution, Timing
from servoloop.stack import hardware
from servoloop.stack.control_stack import ControlStack
from servoloop.stack.hardware import HardwareKind
from servoloop.stack.pick_place import PickPlace
from servoloop.stack.processes import Interrupted
from servoloop.stack.robot_files import Files

if TYPE_CHECKING:
    from servoloop.stack.virtual_lines import VirtualLines


Pose = Mapping[str, float]
"""Joint positions in rad or m, keyed by joint name."""
WAY: Final = 0.3
"""Travel of each joint, in rad or m; at most a quarter of the joint's range."""


def slow(files: Files, back_to: Pose | None = None) -> Files:
    """Return the files with the velocity limits reduced to a quarter, for the controllers and the safety gate.

    Args:
        files: Files of the arm.
        back_to: Pose to which the arm moves when the stack ends, before its torque is disabled.
    """
    limits = {name: replace(one, velocity=SPEED_SHARE * one.velocity) for name, one in files.limits.items()}
    if back_to is None:
        return replace(files, limits=limits)
    ending = {"park": ParkFile(pose=dict(back_to), velocity_scale=1.0), "on_exit": ExitFile(virtual="relax")}
    robot = replace(files.robot, file=files.robot.file.model_copy(update=ending))
    return replace(files, limits=limits, robot=robot)


def bench_poses(jobs: Iterable[PickPlace], limits: Mapping[str, JointLimits]) -> list[Pose]:
    """Return the poses of the measurement: the ready pose, then for each joint a small motion towards its middle and
    back.

    Args:
        jobs: Parameters of each arm's pick-and-place node.
        limits: Limits of each joint.
    """
    ready = {joint: at for job in jobs for joint, at in zip(job.joints, job.poses.ready, strict=True)}
    poses: list[Pose] = [ready]
    for joint, position in ready.items():
        poses += [{**ready, joint: position + _way(position, limits[joint])}, ready]
    return poses


def _way(position: float, limits: JointLimits) -> float:
    way = min(WAY, 0.25 * (limits.upper - limits.lower))
    return way if position < 0.5 * (limits.lower + limits.upper) else -way


def seconds_for(start: Pose, end: Pose, limits: Mapping[str, JointLimits]) -> float:
    """Return a duration, in seconds, that keeps a motion well within the velocity limits."""
    return 0.6 + max(1.4 * abs(position - start[joint]) / limits[joint].velocity for joint, position in end.items())


REST_S: Final = 1.5
"""Time at rest after each motion, in seconds, so that gravity compensation settles."""
BACK: Final = "the arm returns to its initial pose, and its torque is disabled"
LOG = logging.getLogger("servoloop")


@dataclass(slots=True)
class BenchTrial:
    """Measurements from each cycle."""

    joints: tuple[str, ...]
    rate_hz: float
    limits: Mapping[str, JointLimits]
    """Limits of each joint, with reduced velocities."""
    lay: dict[str, float] = field(default_factory=dict)
    """Initial position of each joint, including the hand, in rad or m."""
    time_s: list[float] = field(default_factory=list)
    reference: list[FloatArray] = field(default_factory=list)
    """Reference positions (joints,) of each cycle, in rad or m."""
    velocity: list[FloatArray] = field(default_factory=list)
    """Reference velocities (joints,) of each cycle, in rad/s or m/s."""
    position: list[FloatArray] = field(default_factory=list)
    """Measured positions (joints,) of each cycle, in rad or m."""
    late_s: list[float] = field(default_factory=list)
    took_s: list[float] = field(default_factory=list)
    missed: int = 0

    @property
    def timing(self) -> Timing:
        """Timing of the control loop."""
        return Timing(
            self.rate_hz, len(self.late_s), self.missed, Distribution.of(self.late_s), Distribution.of(self.took_s)
        )


def run_trial(
    files: Files,
    poses: Sequence[Pose],
    devices: Mapping[str, str],
    clock: Clock,
    signals: Callable[[], int] = lambda: 0,
    virtual: "VirtualLines | None" = None,
) -> BenchTrial:
    """Measure an arm while it moves through the poses and back to its initial pose.

    At the start and at the end, the torque is off, even after an error. Only a second signal skips the return motion.

    Args:
        files: Files of the arm, with reduced velocity limits.
        poses: Poses of the joints that belong to the trajectory controllers.
        devices: Serial device of each bus, keyed by bus name.
        clock: Clock of the control loop.
        signals: Function that returns the number of signals received.
        virtual: Virtual buses in this process, used instead of the devices.

    Raises:
        DriverError: The arm is not following its commands, or its torque may still be on.
        Interrupted: A signal was received.
    """
    setup = hardware.build(HardwareKind.SERVOS, files, devices, clock, virtual)
    stack = ControlStack.build(setup, files, clock)
    stack.load_controllers()
    loop, arms = stack.loop, _arm_controllers(stack, poses[0])
    joints = tuple(joint for arm in arms for joint in arm.joints)
    trial = BenchTrial(joints, 1.0 / loop.period_s, files.limits)
    with stack.configured():
        loop.activate()
        names = [name.rpartition("/")[0] for name in setup.hardware.command_interfaces]
        trial.lay = dict(zip(names, loop.command.tolist(), strict=True))
        try:
            _drive(loop, arms, poses, trial, signals)
        finally:
            problems = stack.end(lambda: signals() > 1, trial.lay)
            for problem in problems:
                LOG.error("torque may still be on: %s", problem)
    if problems:
        raise DriverError("; ".join(problems))
    if signals():
        raise Interrupted("interrupted; the arm's torque is off")
    return trial


def _arm_controllers(stack: ControlStack, pose: Pose) -> list[JointTrajectoryController]:
    """Return the controllers that move the joints of a pose. Raises DriverError if a joint has no such controller."""
    loaded = stack.loop.manager.registry.controllers.values()
    arms = [one for one in loaded if isinstance(one, JointTrajectoryController) and pose.keys() >= set(one.joints)]
    if missing := pose.keys() - {joint for arm in arms for joint in arm.joints}:
        path, names = stack.files.controllers.path, ", ".join(sorted(missing))
        raise DriverError(f"{path} has no joint trajectory controller for {names}, which the measurement needs")
    return arms


def _drive(
    loop: ControlLoop,
    arms: Sequence[JointTrajectoryController],
    poses: Sequence[Pose],
    trial: BenchTrial,
    signals: Callable[[], int],
) -> None:
    """Run the control loop until the rest period after the last pose ends."""
    moves = _moves(arms, poses, trial, loop.period_s)
    figures = loop.figures

    def ended() -> bool:
        if figures.cycles > len(trial.late_s):
            trial.late_s.append(figures.last_late_s)
            trial.took_s.append(figures.last_busy_s)
            trial.missed = figures.missed
            now = [arm.tracking for arm in arms if arm.tracking is not None]
            if len(now) == len(arms):
                trial.time_s.append(now[0].stamp_s)
                trial.reference.append(np.concatenate([one.reference.position for one in now]))
                trial.velocity.append(np.concatenate([one.reference.velocity for one in now]))
                trial.position.append(np.concatenate([one.feedback_position for one in now]))
        return signals() > 0 or next(moves, None) is None

    loop.run(ended)


def _moves(
    arms: Sequence[JointTrajectoryController], poses: Sequence[Pose], trial: BenchTrial, period_s: float
) -> Iterator[bool]:
    """Send the goals, and yield in each cycle until the last motion and its rest period have ended."""
    for before, pose in pairwise([trial.lay, *poses]):
        seconds = seconds_for(before, pose, trial.limits)
        goals = [TrajectoryGoal(a.joints, (GoalPoint(tuple(pose[j] for j in a.joints), seconds),)) for a in arms]
        for arm, goal in zip(arms, goals, strict=True):
            if reason := arm.check(goal):
                raise DriverError(f"the arm cannot move to the next pose: {reason}; {BACK}")
        handles = [arm.submit(goal) for arm, goal in zip(arms, goals, strict=True)]
        while not all(handle.done for handle in handles):
            yield True
        for handle in handles:
            if handle.status is not GoalStatus.SUCCEEDED:
                raise DriverError(
                    f"the arm is not following its commands: {handle.error_text}; {BACK}. Run servoloop doctor"
                )
        for _ in range(round(REST_S / period_s)):
            yield True
