"""Forward velocities or efforts, which become 0 if the client stops repeating them.

Unlike in ros2_control, a command becomes 0 after ``command_timeout`` without a new message, so that a crashed client or
a lost message does not leave the arm moving.
"""

import logging
from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from controller.forward.commands import ForwardParameters, Inbox
from controller.interface import ControllerContext, limits_of
from controller.parameters import Parameters
from hal.types import FloatArray, JointLimits, JointState

LOG = logging.getLogger("servoloop.controller")


class RateCommandController:
    """Controller for velocities or efforts, which commands 0 until the first message.

    Velocities change within the acceleration limits of the joints.
    """

    parameters_type: ClassVar[type[Parameters]] = ForwardParameters
    settable: ClassVar[frozenset[str]] = frozenset({"command_timeout"})

    def __init__(self, kind: str, name: str, parameters: ForwardParameters, limits: Sequence[JointLimits]) -> None:
        """Create a controller. ``limits`` are in the same order as the joints."""
        self.kind = kind
        self.name = name
        self.parameters = parameters
        self.joints = parameters.joints
        self.command_interfaces = parameters.claims()
        self.state_interfaces: tuple[str, ...] = ()
        self.command: FloatArray = np.zeros(len(self.joints))
        velocity = parameters.interface_name == "velocity"
        ranges = [limit.command_range(parameters.interface_name) for limit in limits]
        self._lowest, self._highest = np.array(ranges).T
        self._quickest = np.array([limit.acceleration if velocity else np.inf for limit in limits])
        self._inbox = Inbox(self.joints, parameters.deactivate_on_wrong_length)
        self._wanted: FloatArray = np.zeros(len(self.joints))
        self._age_s = 0.0

    @classmethod
    def build_as(
        cls, kind: str, name: str, parameters: ForwardParameters, context: ControllerContext
    ) -> "RateCommandController":
        """Build a controller of type ``kind`` from its parameters and the robot."""
        return cls(kind, name, parameters, limits_of(parameters.joints, context.limits))

    def reconfigure(self, parameters: ForwardParameters) -> None:
        """Set ``command_timeout``."""
        self.parameters = parameters

    def submit(self, values: Sequence[float]) -> str | None:
        """Submit a command from any thread. Return None, or the reason why the command is dropped.

        An empty command is ignored.
        """
        return self._inbox.submit(values)

    def activate(self, state: JointState, command: FloatArray) -> None:
        self._rest()
        self.command = np.where(np.isfinite(command), command, 0.0)

    def deactivate(self, reason: str = "") -> None:
        self._rest()

    def update(self, state: JointState, now_s: float, period_s: float) -> None:
        newest = self._inbox.take()
        self._age_s = 0.0 if newest is not None else self._age_s + period_s
        if newest is not None:
            self._wanted = self._bounded(newest)
        elif self._is_stale():
            LOG.warning("%s: no command for %.2f s; the command is now 0", self.name, self._age_s)
            self._wanted = np.zeros_like(self._wanted)
        step = self._quickest * period_s
        self.command = np.clip(self._wanted, self.command - step, self.command + step)

    def settled(self) -> bool:
        """Return whether the commands of all joints are 0."""
        return not self._inbox and not self._wanted.any() and not self.command.any()

    def _rest(self) -> None:
        self._inbox.clear()
        self._wanted = np.zeros(len(self.joints))
        self.command = np.zeros(len(self.joints))

    def _bounded(self, wanted: FloatArray) -> FloatArray:
        clipped = np.clip(wanted, self._lowest, self._highest)
        if (clipped != wanted).any():
            LOG.warning("%s: %s is beyond the limits; the command is %s instead", self.name, wanted, clipped)
        return clipped

    def _is_stale(self) -> bool:
        allowed_s = self.parameters.command_timeout
        return 0.0 < allowed_s < self._age_s and bool(self._wanted.any())
