"""Monitor the measured state of the robot on /joint_states."""

import math
from collections.abc import Callable
from time import monotonic
from typing import Final

from rclpy.node import Node
from sensor_msgs.msg import JointState

from nodes.pick_place.waiter import Waiter
from nodes.planning.request_errors import RequestError
from nodes.publishing import ANY_CLIENT
from planning.robot import PlanningRobot

STALE_S: Final = 2.0
"""Maximum age at which a measured position is still used, in seconds."""

POLL_S: Final = 0.05
"""Period of the checks for the first joint positions, in seconds."""


class JointMonitor:
    """Positions of the driven joints. All methods must be called from the executor thread."""

    def __init__(self, node: Node, robot: PlanningRobot) -> None:
        self._robot = robot
        self._waiter = Waiter(node)
        self._positions: dict[str, float] = {}
        self._seen_s: dict[str, float] = {}
        self.listeners: list[Callable[[], None]] = []
        """Functions to call after each message."""
        self._topic = node.resolve_topic_name("joint_states")
        node.create_subscription(JointState, self._topic, self._on_states, ANY_CLIENT)

    def state(self) -> dict[str, float]:
        """Return the positions of all driven joints, in rad or m.

        Raises:
            RequestError: A joint was not measured recently.
        """
        now_s = monotonic()
        for joint in self._robot.limits:
            if now_s - self._seen_s.get(joint, float("-inf")) > STALE_S:
                raise RequestError(
                    "ROBOT_STATE_STALE",
                    f"no position of {joint} has been published on {self._topic} for {STALE_S:g} s: start the stack",
                )
        return {joint: self._positions[joint] for joint in self._robot.limits}

    async def wait(self) -> None:
        """Wait for the first positions, which arrive shortly after this server starts, for at most ``STALE_S``."""
        for _ in range(round(STALE_S / POLL_S)):
            if self._seen_s.keys() >= self._robot.limits.keys():
                return
            await self._waiter.until(POLL_S)

    def _on_states(self, message: JointState) -> None:
        now_s = monotonic()
        for name, position in zip(message.name, message.position, strict=False):
            if math.isfinite(position) and name in self._robot.limits:
                self._positions[name] = position
                self._seen_s[name] = now_s
        for listener in list(self.listeners):
            listener()
