"""Read the joint positions of a virtual arm directly from its emulator, without a stack."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

import numpy as np

from drivers.clock import Clock
from hal.robot_description.description import Description
from hal.types import JointState
from servoloop.recording.mcap_messages import Received
from servoloop.recording.messages import Messages, Recorded
from servoloop.recording.robot_state import ObservedRobot
from servoloop.recording.sampler import WORLD, CycleSample, LinkPose
from servoloop.recording.stream import LiveError
from sim_backend.scene.world_feed import WorldFeedClient, feed_path

AGAIN_S: Final = 1.0
"""Time between attempts to reconnect to an emulator, in seconds."""


class EmulatorSource:
    """Latest state of the virtual arm at ``link``. Not thread-safe."""

    def __init__(self, link: Path, description: Description, clock: Clock) -> None:
        """Connect to ``servoloop emulate`` at ``link``. Raises LiveError if no emulator is running at this path."""
        self._link, self._description, self._clock = link, description, clock
        self._client: WorldFeedClient | None = None
        self._messages: Messages | None = None
        self._again_s = 0.0
        self._robot = ObservedRobot()
        self._connect()
        if self._client is None:
            raise LiveError(f"no virtual arm is running at {link}: start the arm with `servoloop emulate {link}`")

    @property
    def up_to_date(self) -> bool:
        """Whether the emulator is connected."""
        return self._client is not None

    @property
    def status(self) -> str:
        """Path of the virtual arm, with a note that states whether its emulator is running."""
        return f"{self._link}: virtual servos" if self.up_to_date else f"{self._link}: the emulator has stopped"

    @property
    def robot(self) -> ObservedRobot:
        """Arm in its last published state."""
        if self._client is None and self._clock.now() >= self._again_s:
            self._connect()
        if self._client is not None:
            newest = self._client.newest()
            if newest is not None:
                self._update(newest)
            if self._client.ended:
                self._client = None
        return self._robot

    def close(self) -> None:
        """Close the connection."""
        if self._client is not None:
            self._client.close()

    def _connect(self) -> None:
        self._again_s = self._clock.now() + AGAIN_S
        try:
            self._client = WorldFeedClient(feed_path(self._link))
        except OSError:
            return
        self._robot, self._messages = ObservedRobot(), None

    def _update(self, published: dict[str, Any]) -> None:
        """Convert a state published by the emulator to the messages of a stack, and process them."""
        stamp_s, joints = published["time_s"], published["joints"]
        if self._messages is None:
            self._messages = Messages(self._description, list(joints), (), 0.0)
            self._process(self._messages.latched(stamp_s))
        unknown = np.full(len(joints), np.nan)
        state = JointState(stamp_s, np.array(list(joints.values())), unknown, unknown)
        scene = tuple(
            LinkPose(WORLD, name, tuple(pose["position_m"]), tuple(pose["quaternion_xyzw"]))
            for name, pose in published["poses"].items()
        )
        nothing = np.empty(0)
        self._process(self._messages.of_cycle(CycleSample(state, nothing, (), (), (), (), None, (), scene)))

    def _process(self, messages: Iterable[Recorded]) -> None:
        for one in messages:
            self._robot.take(Received(one.topic, one.stamp_ns, one.message, 0))
