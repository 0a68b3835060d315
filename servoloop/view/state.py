"""The state of a robot as its messages tell it: what the page shows, and the last minute of all numbers."""

import math
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np

from hal.types import FloatArray
from servoloop.recorder.reader import COMMANDS, CYCLES, DIAGNOSTICS, RESULT, STATES

HISTORY_S: Final = 60.0
DESCRIPTION: Final = "/robot_description"
GOAL: Final = "/goal"
OF_SERVO: Final = " (servo "
OWN: Final = "servoloop: "


class Diagnostic(NamedTuple):
    """One status of /diagnostics."""

    level: int
    name: str
    message: str
    values: dict[str, str]

    @property
    def joint(self) -> str | None:
        """The joint whose servo it is about; None where it is about something else."""
        name, servo, _ = self.name.removeprefix(OWN).partition(OF_SERVO)
        return name if servo else None

    def number(self, key: str) -> float:
        """A value as a number, NaN where there is none."""
        try:
            return float(self.values.get(key, "nan"))
        except ValueError:
            return math.nan


class Goal(NamedTuple):
    """The newest goal of a trajectory controller: its points (k, joints) in rad or m, and the arm's place (n,) then."""

    joints: tuple[str, ...]
    points: FloatArray
    start: FloatArray
    end: str
    """How it ended, empty while it is under way."""


class Sample(NamedTuple):
    """One cycle: ROS time, and arrays (n,) in rad or m, per second, N m or N; V and °C."""

    time_s: float
    position: FloatArray
    velocity: FloatArray
    effort: FloatArray
    command: FloatArray
    """As the safety gate passed it, NaN where nothing is commanded."""
    voltage_v: FloatArray
    temperature_c: FloatArray

    @property
    def error(self) -> FloatArray:
        """Command - position."""
        return self.command - self.position


@dataclass(slots=True)
class RobotState:
    """What is known of a robot; one thread writes by ``take``, others read."""

    xml: str = ""
    joints: tuple[str, ...] = ()
    history: deque[Sample] = field(default_factory=deque)
    """The last minute."""
    diagnostics: tuple[Diagnostic, ...] = ()
    goals: dict[str, Goal] = field(default_factory=dict)
    """By controller."""
    late_s: float = math.nan
    busy_s: float = math.nan
    missed: int = 0

    @property
    def newest(self) -> Sample | None:
        """The newest cycle, None before the first."""
        return self.history[-1] if self.history else None

    def take(self, topic: str, stamp_ns: int, message: Any) -> None:
        """Take one message of a recording or of a feed."""
        if topic == STATES:
            self._take_states(stamp_ns * 1e-9, message)
        elif topic == COMMANDS:
            self._take_commands(message)
        elif topic == DIAGNOSTICS:
            self.diagnostics = tuple(map(_diagnostic, message.status))
        elif topic == CYCLES:
            self.late_s, self.busy_s, self.missed = message.late_s, message.busy_s, message.missed
        elif topic == DESCRIPTION:
            self.xml = message.data
        elif topic.endswith(GOAL) and hasattr(message, "points"):
            self._take_goal(topic.removesuffix(GOAL).strip("/"), message)
        elif topic.endswith(RESULT):
            name = topic.removesuffix(RESULT).strip("/")
            if name in self.goals:
                text = f"{message.status} {message.error_string}".strip()
                self.goals[name] = self.goals[name]._replace(end=text)

    def of_joint(self, joint: str) -> Diagnostic | None:
        """The newest diagnostic of a joint's servo."""
        return next((one for one in self.diagnostics if one.joint == joint), None)

    def _take_states(self, time_s: float, message: Any) -> None:
        self.joints = tuple(message.name)
        none = np.full(len(self.joints), math.nan)

        def full(values: FloatArray) -> FloatArray:
            return np.array(values) if len(values) == len(none) else none

        sample = Sample(
            time_s,
            full(message.position),
            full(message.velocity),
            full(message.effort),
            none,
            self._numbers("voltage_v"),
            self._numbers("temperature_c"),
        )
        self.history.append(sample)
        while time_s - self.history[0].time_s > HISTORY_S:
            self.history.popleft()

    def _take_commands(self, message: Any) -> None:
        if not self.history:
            return
        command = np.full(len(self.joints), math.nan)
        for name, value in zip(message.name, message.position, strict=False):
            if name in self.joints:
                command[self.joints.index(name)] = value
        self.history[-1] = self.history[-1]._replace(command=command)

    def _take_goal(self, controller: str, message: Any) -> None:
        points = np.array([point.positions for point in message.points], np.float64)
        if self.newest is None or points.ndim != 2:
            return
        self.goals[controller] = Goal(tuple(message.joint_names), points, self.newest.position, "")

    def _numbers(self, key: str) -> FloatArray:
        found: Iterator[Diagnostic | None] = map(self.of_joint, self.joints)
        return np.array([math.nan if one is None else one.number(key) for one in found])


def column(samples: Sequence[Sample], name: str, place: int) -> FloatArray:
    """One joint's numbers of a history as an array (m,)."""
    return np.array([getattr(sample, name)[place] for sample in samples])


def _diagnostic(status: Any) -> Diagnostic:
    level = status.level[0] if isinstance(status.level, bytes) else int(status.level)
    return Diagnostic(level, status.name, status.message, {one.key: one.value for one in status.values})
