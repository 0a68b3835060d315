"""Collect the latest state and the last minute of data of a robot from the messages of a live stream or a recording."""

import math
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, NamedTuple

import numpy as np

from hal.robot_description.description import Vector
from hal.robot_description.kinematics import Quaternion
from hal.types import FloatArray
from servoloop.recording.history import KEPT_S, Curves, History, HistoryRow
from servoloop.recording.joint_values import JointValues, widened
from servoloop.recording.mcap_messages import (
    COMMANDS,
    CYCLES,
    GOAL,
    RESULT,
    SCENE,
    STATES,
    STATUSES,
    URDF,
    Received,
)
from servoloop.recording.pictures import Pictures

RESULTS: Final = 50
"""Maximum number of goal results kept."""
NOBODY: Final = np.empty(0)


class ScenePose(NamedTuple):
    """Pose of an object in the world: position in meters and orientation as a unit quaternion (x, y, z, w)."""

    position_m: Vector
    quaternion: Quaternion


@dataclass(frozen=True, slots=True)
class StatusNow:
    """Latest diagnostic status with a given name. Level 0 is OK, 1 is a warning, and 2 is an error."""

    level: int
    message: str
    hardware_id: str
    values: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class GoalPath:
    """Latest goal of a controller: positions (k, joints) in rad or m, and times (k,) in seconds from the start of the
    goal."""

    joints: tuple[str, ...]
    time_s: FloatArray
    positions: FloatArray
    begun_s: float
    ended: str = ""
    """Result of the goal, or empty while the goal is running."""


@dataclass(frozen=True, slots=True)
class RobotSnapshot:
    """Immutable state of a robot at one time. Arrays (n,) are in the order of ``joints``, in rad or m."""

    description_xml: str = ""
    """URDF of the robot, or an empty string before it is received."""
    joints: tuple[str, ...] = ()
    stamp_s: float = 0.0
    """ROS time of the measurement, in seconds, or 0 before the first measurement."""
    position: FloatArray = field(default_factory=lambda: NOBODY)
    velocity: FloatArray = field(default_factory=lambda: NOBODY)
    effort: FloatArray = field(default_factory=lambda: NOBODY)
    command: FloatArray = field(default_factory=lambda: NOBODY)
    """Commanded positions after the safety gate, with NaN for joints without a command."""
    late_s: float = 0.0
    busy_s: float = 0.0
    cycles: int = 0
    missed: int = 0
    statuses: Mapping[str, StatusNow] = field(default_factory=dict)
    """Diagnostic statuses, keyed by name, such as ``servoloop: joint1 (servo 1)``."""
    goals: Mapping[str, GoalPath] = field(default_factory=dict)
    """Latest goal of each controller."""
    results: tuple[tuple[float, str], ...] = ()
    """ROS time and text of each goal result, in chronological order."""
    scene: Mapping[str, ScenePose] = field(default_factory=dict)
    """Poses of the objects around the arm, keyed by name. Empty if there is no simulation."""
    lost_cycles: int = 0
    """Number of cycles lost because this program was too slow."""

    @property
    def error(self) -> FloatArray:
        """Command minus position, (n,)."""
        return self.command - self.position

    @property
    def faults(self) -> dict[str, str]:
        """Error messages, keyed by status name."""
        return {name: status.message for name, status in self.statuses.items() if status.level >= 2}


class ReportedState:
    """State of a robot. One thread updates the state with messages; any thread may read it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._now, self._values = RobotSnapshot(), JointValues()
        self._history = History()
        self._results: deque[tuple[float, str]] = deque(maxlen=RESULTS)
        self._sequence: int | None = None

    def take(self, received: Received) -> None:
        """Update the state with one message. Messages on other topics are ignored."""
        with self._lock:
            self._take(received)

    @property
    def snapshot(self) -> RobotSnapshot:
        """Current state of the robot."""
        with self._lock:
            return self._now

    def curves(self) -> Curves:
        """Return the joint values of the last minute."""
        with self._lock:
            return self._history.curves()

    def _take(self, received: Received) -> None:
        topic, message = received.topic, received.message
        if topic == STATES:
            self._count(received.sequence)
            self._measured(received)
        elif topic == COMMANDS:
            self._commanded(message)
        elif topic == CYCLES:
            self._now = replace(
                self._now,
                late_s=message.late_s,
                busy_s=message.busy_s,
                cycles=message.number,
                missed=message.missed,
            )
        elif topic == STATUSES:
            self._now = replace(self._now, statuses={one.name: _status(one) for one in message.status})
        elif topic == SCENE:
            self._now = replace(self._now, scene=dict(map(_scene_pose, message.transforms)))
        elif topic == URDF:
            self._now = replace(self._now, description_xml=message.data)
        elif topic.endswith(GOAL):
            self._goal(topic.removesuffix(GOAL).strip("/"), received)
        elif topic.endswith(RESULT):
            self._result(topic.removesuffix(RESULT).strip("/"), received)

    def _count(self, sequence: int) -> None:
        if self._sequence is not None and sequence > self._sequence + 1:
            lost = self._now.lost_cycles + sequence - self._sequence - 1
            self._now = replace(self._now, lost_cycles=lost)
        self._sequence = sequence

    def _measured(self, received: Received) -> None:
        self._values = values = self._values.with_message(received.message)
        self._now = replace(
            self._now,
            joints=values.joints,
            stamp_s=received.stamp_ns * 1e-9,
            position=values.position,
            velocity=values.velocity,
            effort=values.effort,
            command=widened(self._now.command, len(values.joints)),
        )

    def _commanded(self, message: Any) -> None:
        """Store the commands of the last measured cycle, and add a row for this cycle to the history."""
        now = self._now
        positions = dict(zip(message.name, message.position, strict=False))
        command = np.array([positions.get(joint, np.nan) for joint in now.joints])
        self._now = now = replace(now, command=command)
        self._history.add(HistoryRow(now.stamp_s, now.position, command, now.velocity, now.effort))

    def _goal(self, controller: str, received: Received) -> None:
        message, begun_s = received.message, received.stamp_ns * 1e-9
        if hasattr(message, "points"):
            times = np.array([_seconds(point.time_from_start) for point in message.points])
            if {len(point.positions) for point in message.points} != {len(message.joint_names)}:
                return  # The goal contains only velocities, or another program sent an invalid goal.
            path = GoalPath(
                tuple(message.joint_names), times, np.array([point.positions for point in message.points]), begun_s
            )
        else:
            path = GoalPath(tuple(message.name), np.zeros(1), np.array([message.position]), begun_s)
        self._now = replace(self._now, goals={**self._now.goals, controller: path})

    def _result(self, controller: str, received: Received) -> None:
        message = received.message
        text = f"{message.status} {message.error_string}".strip()
        self._results.append((received.stamp_ns * 1e-9, f"{controller}: {text}"))
        goals = dict(self._now.goals)
        if controller in goals:
            goals[controller] = replace(goals[controller], ended=text)
        self._now = replace(self._now, goals=goals, results=tuple(self._results))


def _scene_pose(transform: Any) -> tuple[str, ScenePose]:
    place, turn = transform.transform.translation, transform.transform.rotation
    return transform.child_frame_id, ScenePose((place.x, place.y, place.z), (turn.x, turn.y, turn.z, turn.w))


def _status(one: Any) -> StatusNow:
    level = one.level[0] if isinstance(one.level, bytes) else int(one.level)
    return StatusNow(level, one.message, one.hardware_id, {pair.key: pair.value for pair in one.values})


def _seconds(time: Any) -> float:
    """Return a builtin_interfaces/Duration in seconds."""
    return float(time.sec) + float(time.nanosec) * 1e-9


OWN: Final = "servoloop: "
OF_SERVO: Final = " (servo "
FAULT: Final = 2
"""Error level of a diagnostic status."""


def servo_status(snapshot: RobotSnapshot, joint: str) -> StatusNow | None:
    """Return the diagnostic status of a joint's servo, or None if the joint has no servo."""
    prefix = f"{OWN}{joint}{OF_SERVO}"
    return next((status for name, status in snapshot.statuses.items() if name.startswith(prefix)), None)


def servo_faults(snapshot: RobotSnapshot) -> dict[str, str]:
    """Return the error messages of servos, keyed by joint name."""
    found = {joint: servo_status(snapshot, joint) for joint in snapshot.joints}
    return {joint: one.message for joint, one in found.items() if one is not None and one.level >= FAULT}


class Health(NamedTuple):
    """Supply voltages and temperatures of the servos at one time: arrays (n,) in joint order, with NaN for unknown
    values."""

    stamp_s: float
    voltage_v: FloatArray
    temperature_c: FloatArray


class Minute(NamedTuple):
    """Joint values and servo health of the last minute."""

    curves: Curves
    health: Sequence[Health]


class ObservedRobot:
    """Robot with its state and history. One thread updates it with messages; any thread may read it."""

    def __init__(self) -> None:
        self.state = ReportedState()
        self.pictures = Pictures()
        self._lock = threading.Lock()
        self._health: deque[Health] = deque()

    def take(self, received: Received) -> None:
        """Update the robot with one message."""
        self.state.take(received)
        self.pictures.take(received)
        if received.topic != STATUSES:
            return
        now = received.stamp_ns * 1e-9
        with self._lock:
            self._health.append(health(self.state.snapshot)._replace(stamp_s=now))
            while now - self._health[0].stamp_s > KEPT_S:
                self._health.popleft()

    def minute(self) -> Minute:
        """Return the values of the last minute, with the servos' health at about one sample per second."""
        with self._lock:
            health_rows = list(self._health)
        return Minute(self.state.curves(), health_rows)

    def start(self, goal: GoalPath) -> FloatArray | None:
        """Return the joint positions (n,) at the start of a goal, or None if the history starts later."""
        curves = self.state.curves()
        at = int(np.searchsorted(curves.time_s, goal.begun_s, side="right")) - 1
        return None if at < 0 else np.asarray(curves.position[at])


def health(snapshot: RobotSnapshot) -> Health:
    """Return the servos' health from the latest diagnostics."""

    def numbers(key: str) -> FloatArray:
        found = (servo_status(snapshot, joint) for joint in snapshot.joints)
        return np.array([math.nan if one is None else float(one.values.get(key, "nan")) for one in found])

    return Health(snapshot.stamp_s, numbers("voltage_v"), numbers("temperature_c"))


def health_column(rows: Sequence[Health], name: str, place: int) -> FloatArray:
    """Return one health value of a joint over time, with shape (m,). Rows that do not contain the joint are NaN."""
    columns = [getattr(row, name) for row in rows]
    return np.array([column[place] if place < len(column) else math.nan for column in columns])
