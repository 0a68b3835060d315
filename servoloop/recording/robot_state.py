"""The newest state of a robot, put together from the messages of a live stream or a recording."""

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
from servoloop.recording.history import KEPT_S, Curves, History, Row
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

RESULTS: Final = 50
"""So many ends of goals are kept."""
NOBODY: Final = np.empty(0)


class ScenePose(NamedTuple):
    """The pose of a thing in the world: metres and a unit quaternion (x, y, z, w)."""

    position_m: Vector
    quaternion: Quaternion


@dataclass(frozen=True, slots=True)
class StatusNow:
    """One entry of /diagnostics, as the stack has said it last; level 0 is well, 1 a warning, 2 an error."""

    level: int
    message: str
    hardware_id: str
    values: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class GoalPath:
    """The newest goal of a controller: (k, joints) positions in rad or m and their times (k,) in s from its start."""

    joints: tuple[str, ...]
    time_s: FloatArray
    positions: FloatArray
    begun_s: float
    ended: str = ""
    """How it ended; empty while it is under way."""


@dataclass(frozen=True, slots=True)
class Snapshot:
    """A robot at one moment. Arrays (n,) in the order of ``joints``, rad or m; a snapshot never changes."""

    description_xml: str = ""
    """The URDF; empty until it has come."""
    joints: tuple[str, ...] = ()
    stamp_s: float = 0.0
    """ROS time of the measurement; 0 before the first."""
    position: FloatArray = field(default_factory=lambda: NOBODY)
    velocity: FloatArray = field(default_factory=lambda: NOBODY)
    effort: FloatArray = field(default_factory=lambda: NOBODY)
    command: FloatArray = field(default_factory=lambda: NOBODY)
    """As the safety gate let it pass; NaN where none is commanded."""
    late_s: float = 0.0
    busy_s: float = 0.0
    cycles: int = 0
    missed: int = 0
    statuses: Mapping[str, StatusNow] = field(default_factory=dict)
    """By name, as ``servoloop: joint1 (servo 1)``."""
    goals: Mapping[str, GoalPath] = field(default_factory=dict)
    """By controller."""
    results: tuple[tuple[float, str], ...] = ()
    """The ends of goals: ROS time and text, the newest last."""
    scene: Mapping[str, ScenePose] = field(default_factory=dict)
    """The things around the arm, by name; empty where no simulation knows them."""
    lost_cycles: int = 0
    """Cycles that this program was too slow to take."""

    @property
    def error(self) -> FloatArray:
        """Command less position, (n,)."""
        return self.command - self.position

    @property
    def faults(self) -> dict[str, str]:
        """What is wrong, by the status's name."""
        return {name: status.message for name, status in self.statuses.items() if status.level >= 2}


class RobotState:
    """One thread gives it messages; any thread takes snapshots."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._now, self._values = Snapshot(), JointValues()
        self._history = History()
        self._results: deque[tuple[float, str]] = deque(maxlen=RESULTS)
        self._sequence: int | None = None

    def take(self, received: Received) -> None:
        """Take one message; topics that are not of a robot's state are left alone."""
        with self._lock:
            self._take(received)

    @property
    def snapshot(self) -> Snapshot:
        """The robot as it is now."""
        with self._lock:
            return self._now

    def curves(self) -> Curves:
        """The last minute."""
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
            self._now = replace(self._now, scene=dict(map(_thing, message.transforms)))
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
        """The commands of the cycle that was measured just before: with them its row is whole."""
        now = self._now
        said = dict(zip(message.name, message.position, strict=False))
        command = np.array([said.get(joint, np.nan) for joint in now.joints])
        self._now = now = replace(now, command=command)
        self._history.add(Row(now.stamp_s, now.position, command, now.velocity, now.effort))

    def _goal(self, controller: str, received: Received) -> None:
        message, begun_s = received.message, received.stamp_ns * 1e-9
        if hasattr(message, "points"):
            times = np.array([_seconds(point.time_from_start) for point in message.points])
            if {len(point.positions) for point in message.points} != {len(message.joint_names)}:
                return  # of velocities alone, or of another program's making
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


def _thing(transform: Any) -> tuple[str, ScenePose]:
    place, turn = transform.transform.translation, transform.transform.rotation
    return transform.child_frame_id, ScenePose((place.x, place.y, place.z), (turn.x, turn.y, turn.z, turn.w))


def _status(one: Any) -> StatusNow:
    level = one.level[0] if isinstance(one.level, bytes) else int(one.level)
    return StatusNow(level, one.message, one.hardware_id, {pair.key: pair.value for pair in one.values})


def _seconds(time: Any) -> float:
    """Of builtin_interfaces/Duration."""
    return float(time.sec) + float(time.nanosec) * 1e-9


OWN: Final = "servoloop: "
OF_SERVO: Final = " (servo "
FAULT: Final = 2
"""The level of an error."""


def servo_status(snapshot: Snapshot, joint: str) -> StatusNow | None:
    """The status of a joint's servo; None where it has none."""
    prefix = f"{OWN}{joint}{OF_SERVO}"
    return next((status for name, status in snapshot.statuses.items() if name.startswith(prefix)), None)


def servo_faults(snapshot: Snapshot) -> dict[str, str]:
    """What is wrong with servos, by joint."""
    said = {joint: servo_status(snapshot, joint) for joint in snapshot.joints}
    return {joint: one.message for joint, one in said.items() if one is not None and one.level >= FAULT}


DIAGNOSTICS: Final = "/diagnostics"


class Health(NamedTuple):
    """What the servos said of themselves at one moment, by joint (n,); NaN where one has not."""

    stamp_s: float
    voltage_v: FloatArray
    temperature_c: FloatArray


class Minute(NamedTuple):
    """The last minute: each cycle, and what the servos said of themselves."""

    curves: Curves
    health: Sequence[Health]


class Watched:
    """One thread gives it messages; any thread reads."""

    def __init__(self) -> None:
        self.state = RobotState()
        self._lock = threading.Lock()
        self._health: deque[Health] = deque()

    def take(self, received: Received) -> None:
        """Take one message."""
        self.state.take(received)
        if received.topic != DIAGNOSTICS:
            return
        now = received.stamp_ns * 1e-9
        with self._lock:
            self._health.append(health(self.state.snapshot)._replace(stamp_s=now))
            while now - self._health[0].stamp_s > KEPT_S:
                self._health.popleft()

    def minute(self) -> Minute:
        """The last minute; of the servos' health about once a second."""
        with self._lock:
            said = list(self._health)
        return Minute(self.state.curves(), said)

    def start(self, goal: GoalPath) -> FloatArray | None:
        """The joints' positions (n,) when a goal began; None where that was not seen."""
        curves = self.state.curves()
        at = int(np.searchsorted(curves.time_s, goal.begun_s, side="right")) - 1
        return None if at < 0 else np.asarray(curves.position[at])


def health(snapshot: Snapshot) -> Health:
    """What the newest diagnostics say of the servos."""

    def numbers(key: str) -> FloatArray:
        found = (servo_status(snapshot, joint) for joint in snapshot.joints)
        return np.array([math.nan if one is None else float(one.values.get(key, "nan")) for one in found])

    return Health(snapshot.stamp_s, numbers("voltage_v"), numbers("temperature_c"))


def health_column(rows: Sequence[Health], name: str, place: int) -> FloatArray:
    """One joint's numbers as an array (m,); NaN for rows of fewer joints."""
    columns = [getattr(row, name) for row in rows]
    return np.array([column[place] if place < len(column) else math.nan for column in columns])
