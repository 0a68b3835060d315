"""Sample each control cycle for the recording. Sampling takes little time, because a sample only refers to immutable
objects.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final, NamedTuple

from controller.action_goals import GoalStatus
from controller.diagnostics import Status, statuses
from controller.gripper.goal import GripperGoal, GripperHandle
from controller.interface import Controller
from controller.loop import ControlLoop
from controller.trajectory.goal import GoalHandle, TrajectoryGoal
from controller.trajectory.goal_result import ErrorCode
from controller.trajectory.sampler import Tracking
from hal.robot_description.description import UrdfJoint, Vector
from hal.robot_description.kinematics import Quaternion, child_pose
from hal.types import FloatArray, JointState, joints_of
from servoloop.recording.bus_tap import BusTaps, Transfer

MOVING = ("revolute", "continuous", "prismatic")


class LinkPose(NamedTuple):
    """Pose of a link relative to its parent: position in meters and orientation as a unit quaternion (x, y, z, w)."""

    parent: str
    child: str
    position_m: Vector
    quaternion: Quaternion


Scene = Callable[[], Mapping[str, tuple[Vector, Quaternion]]]
"""Function that returns the world poses of the objects around the arm, keyed by name; the result is empty without a
simulation."""
WORLD: Final = "base_link"
"""Frame of the objects in a scene, as in /tf."""


def scene_poses(scene: Scene) -> tuple[LinkPose, ...]:
    """Return the current poses of the objects around the arm."""
    return tuple(LinkPose(WORLD, name, *pose) for name, pose in scene().items())


class LinkPoses:
    """Poses of all links of a robot description, including links of mimic joints."""

    def __init__(self, joints: Mapping[str, UrdfJoint], measured: Sequence[str]) -> None:
        """``measured`` lists the joints of the hardware in the order used in its states."""
        self.fixed = [_pose(joint, 0.0) for joint in joints.values() if joint.kind == "fixed"]
        self._moving = list(_moving(joints, measured))

    def moving(self, position: FloatArray) -> Iterator[LinkPose]:
        """Yield the poses of moving links at joint positions (n,) in rad or m. Skip links whose joint position is
        NaN."""
        values = position.tolist()
        for joint, index, multiplier, offset in self._moving:
            at = values[index] * multiplier + offset
            if at == at:  # not NaN
                yield _pose(joint, at)


def _moving(joints: Mapping[str, UrdfJoint], measured: Sequence[str]) -> Iterator[tuple[UrdfJoint, int, float, float]]:
    places = {name: index for index, name in enumerate(measured)}
    for joint in joints.values():
        if joint.kind not in MOVING:
            continue
        if joint.name in places:
            yield joint, places[joint.name], 1.0, 0.0
        elif joint.mimic is not None and joint.mimic.joint in places:
            yield joint, places[joint.mimic.joint], joint.mimic.multiplier, joint.mimic.offset


def _pose(joint: UrdfJoint, position: float) -> LinkPose:
    return LinkPose(joint.parent, joint.child, *child_pose(joint, position))


DIAGNOSTICS_S: Final = 1.0
"""Period at which unchanged diagnostics are repeated, in seconds, as on /diagnostics."""


class CycleTiming(NamedTuple):
    """Timing of a cycle, which is known only when the next cycle runs."""

    stamp_s: float
    number: int
    late_s: float
    busy_s: float
    missed: int
    """Number of cycles missed since the loop started."""


class Tracked(NamedTuple):
    """Tracking of a trajectory controller in one cycle. Arrays are in the order of ``joints``."""

    controller: str
    joints: tuple[str, ...]
    tracking: Tracking


class GoalBegin(NamedTuple):
    """Goal that a controller has just accepted. ``joints`` are the joints of the goal."""

    controller: str
    joints: tuple[str, ...]
    goal: TrajectoryGoal | GripperGoal


class GoalEnd(NamedTuple):
    """Result of a goal that has just ended."""

    controller: str
    status: GoalStatus
    error_code: int
    text: str

    @property
    def missed(self) -> bool:
        """Whether the joints violated the path or goal tolerances."""
        return self.error_code in (ErrorCode.PATH_TOLERANCE_VIOLATED, ErrorCode.GOAL_TOLERANCE_VIOLATED)


@dataclass(frozen=True, slots=True)
class CycleSample:
    """Recorded data of one cycle. Arrays are in the order of the hardware's joints, in rad or m. Times are on the
    loop's clock."""

    state: JointState
    command: FloatArray
    """Commands (m,) after the safety gate."""
    tracked: tuple[Tracked, ...]
    """Trajectory controllers that were updated in this cycle."""
    goals: tuple[GoalBegin | GoalEnd, ...]
    diagnostics: tuple[Status, ...]
    """Diagnostics, or empty in cycles without new diagnostics."""
    lost: tuple[str, ...]
    """Names of components that have failed."""
    timing: CycleTiming | None
    """Timing of the previous cycle."""
    transfers: tuple[Transfer, ...]
    """Bus traffic since the previous cycle."""
    scene: tuple[LinkPose, ...] = ()
    """Poses of the objects around the arm, or empty if they were not sampled in this cycle."""


class Sampler:
    """Collector of the data to record in each cycle of a control loop. The loop thread calls the sampler."""

    def __init__(self, loop: ControlLoop, hardware_id: str, servo_ids: Mapping[str, str], taps: BusTaps) -> None:
        """``hardware_id`` and ``servo_ids`` (keyed by joint name) are included in the diagnostics."""
        self._loop = loop
        self._hardware_id = hardware_id
        self._servo_ids = servo_ids
        self._taps = taps
        self._goals: dict[str, GoalHandle | GripperHandle] = {}
        self._ended: dict[str, GoalHandle | GripperHandle] = {}
        """Last goal whose result was recorded, keyed by controller name."""
        self._last_s: float | None = None
        self._cycles = 0
        self._diagnosed_s = -DIAGNOSTICS_S
        self._faults: object = None
        """Faults and lost components in the latest diagnostics."""

    def sample(self, state: JointState) -> CycleSample:
        """Return the sample of the cycle that measured this state and sent the current command."""
        loop = self._loop
        lost = tuple(component.name for component in loop.hardware.lost)
        return CycleSample(
            state,
            loop.command,
            tuple(self._tracked(state)),
            tuple(self._goal_events()),
            self._diagnostics(state, lost),
            lost,
            self._timing(state),
            self._taps.take(),
        )

    def _tracked(self, state: JointState) -> Iterator[Tracked]:
        for entry in self._loop.manager.registry.running:
            # Every controller that follows a trajectory has this attribute.
            tracking = getattr(entry.controller, "tracking", None)
            if isinstance(tracking, Tracking) and tracking.stamp_s == state.stamp_s:
                yield Tracked(entry.controller.name, _joints(entry.controller), tracking)

    def _goal_events(self) -> Iterator[GoalBegin | GoalEnd]:
        for name, controller in self._loop.manager.registry.controllers.items():
            newest, known = getattr(controller, "newest_goal", None), self._goals.get(name)
            if not isinstance(newest, (GoalHandle, GripperHandle)):
                continue
            if newest is not known:
                if known is not None:
                    yield from self._end(name, known)
                self._goals[name] = newest
                goal = newest.goal
                yield GoalBegin(name, goal.joints if isinstance(goal, TrajectoryGoal) else _joints(controller), goal)
            yield from self._end(name, newest)

    def _end(self, name: str, handle: GoalHandle | GripperHandle) -> Iterator[GoalEnd]:
        """Yield the result of a goal, but only once."""
        if not handle.done or self._ended.get(name) is handle:
            return
        self._ended[name] = handle
        if isinstance(handle, GoalHandle):
            yield GoalEnd(name, handle.status, handle.error_code, handle.error_text)
        else:
            yield GoalEnd(name, handle.status, 0, handle.text)

    def _diagnostics(self, state: JointState, lost: tuple[str, ...]) -> tuple[Status, ...]:
        faults = {joint: fault.kind for joint, fault in state.faults.items()}, lost
        if state.stamp_s - self._diagnosed_s < DIAGNOSTICS_S and faults == self._faults:
            return ()
        self._diagnosed_s, self._faults = state.stamp_s, faults
        return tuple(statuses(self._loop, self._hardware_id, self._servo_ids, state))

    def _timing(self, state: JointState) -> CycleTiming | None:
        figures, last_s = self._loop.figures, self._last_s
        counted = figures.cycles != self._cycles
        self._last_s, self._cycles = state.stamp_s, figures.cycles
        if last_s is None or not counted:
            return None
        return CycleTiming(last_s, figures.cycles, figures.last_late_s, figures.last_busy_s, figures.missed)


def _joints(controller: Controller) -> tuple[str, ...]:
    """Return the joints commanded by a controller, in the order of its commands."""
    return _joints_of(controller.command_interfaces)


@cache
def _joints_of(command_interfaces: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(joints_of(command_interfaces)))
