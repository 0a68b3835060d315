"""A virtual arm as a source, without a stack: its joints' positions, as the emulator publishes them."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

import numpy as np

from drivers.clock import Clock
from hal.robot_description.description import Description
from hal.types import JointState
from servoloop.recording.mcap_messages import Received
from servoloop.recording.messages import Messages, Recorded
from servoloop.recording.robot_state import Watched
from servoloop.recording.sampler import WORLD, CycleSample, LinkPose
from servoloop.recording.stream import LiveError
from sim_backend.scene.world_feed import WorldFeedClient, feed_path

AGAIN_S: Final = 1.0
"""The pause before the next attempt to connect to an emulator that has ended."""


class EmulatorSource:
    """The newest state of the virtual arm at ``link``; for one thread."""

    def __init__(self, link: Path, description: Description, clock: Clock) -> None:
        """``link``: where `servoloop emulate` serves. Raises LiveError where it does not."""
        self._link, self._description, self._clock = link, description, clock
        self._client: WorldFeedClient | None = None
        self._messages: Messages | None = None
        self._again_s = 0.0
        self._watched = Watched()
        self._connect()
        if self._client is None:
            raise LiveError(f"no virtual arm is served at {link}: start one with `servoloop emulate {link}`")

    @property
    def well(self) -> bool:
        """Whether the emulator is connected."""
        return self._client is not None

    @property
    def status(self) -> str:
        """Whether the emulator runs."""
        return f"{self._link}: virtual servos" if self.well else f"{self._link}: the emulator has ended"

    @property
    def watched(self) -> Watched:
        """The arm as it was published last."""
        if self._client is None and self._clock.now() >= self._again_s:
            self._connect()
        if self._client is not None:
            newest = self._client.newest()
            if newest is not None:
                self._take(newest)
            if self._client.ended:
                self._client = None
        return self._watched

    def close(self) -> None:
        """End."""
        if self._client is not None:
            self._client.close()

    def _connect(self) -> None:
        self._again_s = self._clock.now() + AGAIN_S
        try:
            self._client = WorldFeedClient(feed_path(self._link))
        except OSError:
            return
        self._watched, self._messages = Watched(), None

    def _take(self, published: dict[str, Any]) -> None:
        """Take one publication as the messages that a stack would have sent."""
        stamp_s, joints = published["time_s"], published["joints"]
        if self._messages is None:
            self._messages = Messages(self._description, list(joints), (), 0.0)
            self._give(self._messages.latched(stamp_s))
        unknown = np.full(len(joints), np.nan)
        state = JointState(stamp_s, np.array(list(joints.values())), unknown, unknown)
        scene = tuple(
            LinkPose(WORLD, name, tuple(pose["position_m"]), tuple(pose["quaternion_xyzw"]))
            for name, pose in published["poses"].items()
        )
        nothing = np.empty(0)
        self._give(self._messages.of_cycle(CycleSample(state, nothing, (), (), (), (), None, (), scene)))

    def _give(self, messages: Iterable[Recorded]) -> None:
        for one in messages:
            self._watched.take(Received(one.topic, one.stamp_ns, one.message, 0))
