"""Log motions that the joint limits stretch. A stream of trajectories causes at most one warning per minute."""

import logging
import math
from typing import Final

from controller.motion import Path
from controller.trajectory.goal import TrajectoryGoal

LOG = logging.getLogger("servoloop.controller")

STREAM_AGAIN_S: Final = 60.0
"""Minimum time between two warnings about trajectories sent to the topic, in seconds."""


class StretchLog:
    """One controller's log of warnings about motions that the limits stretch."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._logged_s = -math.inf
        self._unlogged = 0

    def log(self, goal: TrajectoryGoal, path: Path, now_s: float) -> None:
        """Log a warning that the limits stretch a goal's path, unless the goal came from the topic shortly after such a
        warning.

        Args:
            goal: The goal.
            path: The goal's path, which takes longer than requested.
            now_s: Current time, in seconds.
        """
        more = ""
        if goal.from_topic:
            if now_s - self._logged_s < STREAM_AGAIN_S:
                self._unlogged += 1
                return
            more = f" ({self._unlogged} more since the last warning about the topic)" if self._unlogged else ""
            self._logged_s, self._unlogged = now_s, 0
        text = "%s: the joint limits stretch the motion from %.2f s to %.2f s%s"
        LOG.warning(text, self._name, path.asked_s, path.duration_s, more)
