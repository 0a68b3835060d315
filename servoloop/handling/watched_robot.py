"""A robot that is looked at already, for who moves it as well."""

from collections.abc import Mapping

from hal.types import JointLimits
from nodes.handling.robot import JointsNow
from servoloop.handling.live_robot import joints_now, limits_of
from servoloop.live.live_source import LiveSource


class WatchedRobot:
    """The robot of a source that follows a running stack."""

    def __init__(self, source: LiveSource) -> None:
        self._source = source
        self._xml = ""
        self._limits: dict[str, JointLimits] = {}

    @property
    def limits(self) -> Mapping[str, JointLimits]:
        """By joint, as the robot description says."""
        snapshot = self._source.watched.state.snapshot
        if snapshot.description_xml != self._xml:
            self._limits, self._xml = limits_of(snapshot), snapshot.description_xml
        return self._limits

    def joints_now(self) -> JointsNow:
        """The joints as the stack has told last."""
        return joints_now(self._source.watched.state.snapshot, self._source.silent_s)
