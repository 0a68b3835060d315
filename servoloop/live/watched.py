"""A robot that is looked at: its state, and the last minute of what only the diagnostics say."""

import math
import threading
from collections import deque
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from hal.types import FloatArray
from servoloop.live.history import KEPT_S, Curves
from servoloop.live.robot_state import GoalPath, RobotState, Snapshot
from servoloop.live.servo_status import servo_status
from servoloop.recorder.mcap_messages import Received

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
