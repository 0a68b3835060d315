"""The sampler takes from each cycle what is recorded: references to what is never changed, so that it costs little."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
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
from hal.types import FloatArray, JointState
from servoloop.recording.bus_tap import BusTaps, Transfer

MOVING = ("revolute", "continuous", "prismatic")


class LinkPose(NamedTuple):
    """The pose of a link in its parent: metres and a unit quaternion (x, y, z, w)."""

    parent: str
    child: str
    position_m: Vector
    quaternion: Quaternion


Scene = Callable[[], Mapping[str, tuple[Vector, Quaternion]]]
"""Says where things stand around the arm, by name, in the world; nothing where no simulation knows."""
WORLD: Final = "base_link"
"""The frame of the things in a scene, as in ROS 2's /tf."""


def scene_poses(scene: Scene) -> tuple[LinkPose, ...]:
    """The poses of the things around the arm now."""
    return tuple(LinkPose(WORLD, name, *pose) for name, pose in scene().items())


class LinkPoses:
    """The links of a robot description; mimic joints follow theirs."""

    def __init__(self, joints: Mapping[str, UrdfJoint], measured: Sequence[str]) -> None:
        """``measured``: the hardware's joints, in the order of its states."""
        self.fixed = [_pose(joint, 0.0) for joint in joints.values() if joint.kind == "fixed"]
        self._moving = list(_moving(joints, measured))

    def moving(self, position: FloatArray) -> Iterator[LinkPose]:
        """The links that move, at the positions (n,) of the joints in rad or m; NaN leaves a link out."""
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
"""The time between two diagnostics while nothing changes, as on /diagnostics."""


class CycleTiming(NamedTuple):
    """How a cycle kept its time; it is known once the next one runs."""

    stamp_s: float
    number: int
    late_s: float
    busy_s: float
    missed: int
    """Cycles since the loop began."""


class Tracked(NamedTuple):
    """A trajectory controller's cycle; arrays of the tracking are in the order of ``joints``."""

    controller: str
    joints: tuple[str, ...]
    tracking: Tracking


class GoalBegin(NamedTuple):
    """A controller has taken a goal; ``joints`` are those of the goal."""

    controller: str
    joints: tuple[str, ...]
    goal: TrajectoryGoal | GripperGoal


class GoalEnd(NamedTuple):
    """A goal has been decided."""

    controller: str
    status: GoalStatus
    error_code: int
    text: str

    @property
    def missed(self) -> bool:
        """Whether the joints left the tolerances of their path or of their goal."""
        return self.error_code in (ErrorCode.PATH_TOLERANCE_VIOLATED, ErrorCode.GOAL_TOLERANCE_VIOLATED)


@dataclass(frozen=True, slots=True)
class CycleSample:
    """What is recorded of one cycle; arrays are in the hardware's order, rad or m and seconds on the loop's clock."""

    state: JointState
    command: FloatArray
    """(m,): as the safety gate has passed it."""
    tracked: tuple[Tracked, ...]
    """The trajectory controllers that were updated."""
    goals: tuple[GoalBegin | GoalEnd, ...]
    diagnostics: tuple[Status, ...]
    """Empty in cycles in which none are due."""
    lost: tuple[str, ...]
    """The names of components that have failed."""
    timing: CycleTiming | None
    """Of the cycle before."""
    transfers: tuple[Transfer, ...]
    """Since the cycle before."""
    scene: tuple[LinkPose, ...] = ()
    """The things around the arm, where they were looked at."""


class Sampler:
    """One sampler for a loop, in the loop's thread."""

    def __init__(self, loop: ControlLoop, hardware_id: str, servo_ids: Mapping[str, str], taps: BusTaps) -> None:
        """``hardware_id`` and ``servo_ids`` (by joint): for the diagnostics."""
        self._loop = loop
        self._hardware_id = hardware_id
        self._servo_ids = servo_ids
        self._taps = taps
        self._goals: dict[str, GoalHandle | GripperHandle] = {}
        self._ended: dict[str, GoalHandle | GripperHandle] = {}
        """The goal of each controller whose end has been recorded last."""
        self._last_s: float | None = None
        self._cycles = 0
        self._diagnosed_s = -DIAGNOSTICS_S
        self._unwell: object = None
        """The faults and losses that the last diagnostics had."""

    def sample(self, state: JointState) -> CycleSample:
        """Take the cycle that has just measured this state and sent its command."""
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
            tracking = getattr(entry.controller, "tracking", None)  # of any controller that tracks a trajectory
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
        """The end of a goal, once."""
        if not handle.done or self._ended.get(name) is handle:
            return
        self._ended[name] = handle
        if isinstance(handle, GoalHandle):
            yield GoalEnd(name, handle.status, handle.error_code, handle.error_text)
        else:
            yield GoalEnd(name, handle.status, 0, handle.text)

    def _diagnostics(self, state: JointState, lost: tuple[str, ...]) -> tuple[Status, ...]:
        unwell = {joint: fault.kind for joint, fault in state.faults.items()}, lost
        if state.stamp_s - self._diagnosed_s < DIAGNOSTICS_S and unwell == self._unwell:
            return ()
        self._diagnosed_s, self._unwell = state.stamp_s, unwell
        return tuple(statuses(self._loop, self._hardware_id, self._servo_ids, state))

    def _timing(self, state: JointState) -> CycleTiming | None:
        figures, last_s = self._loop.figures, self._last_s
        counted = figures.cycles != self._cycles
        self._last_s, self._cycles = state.stamp_s, figures.cycles
        if last_s is None or not counted:
            return None
        return CycleTiming(last_s, figures.cycles, figures.last_late_s, figures.last_busy_s, figures.missed)


def _joints(controller: Controller) -> tuple[str, ...]:
    """The joints that a controller commands, in its order."""
    return tuple(dict.fromkeys(interface.rpartition("/")[0] for interface in controller.command_interfaces))
