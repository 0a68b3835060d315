"""Implement forward_command_controller/ForwardCommandController and ros2_control's group controllers."""

import logging
from collections.abc import Sequence
from typing import ClassVar, Literal

import numpy as np

from controller.forward.approach import Approach
from controller.forward.commands import ForwardParameters, Inbox
from controller.forward.output_controller import OutputController
from controller.forward.rate_command_controller import RateCommandController
from controller.interface import Controller, ControllerContext, indices, limits_of
from controller.parameters import Parameters
from controller.settling import Settling
from hal.types import FloatArray, JointLimits, JointState, position_interfaces

LOG = logging.getLogger("servoloop.controller")


class ForwardCommandController:
    """Controller that moves joints to the positions in the latest message.

    Before the first message, the controller holds the current position. The command approaches the goal within the
    velocity and acceleration limits of the joints.
    """

    kind: ClassVar[str] = "forward_command_controller/ForwardCommandController"
    parameters_type: ClassVar[type[Parameters]] = ForwardParameters
    settable: ClassVar[frozenset[str]] = RateCommandController.settable

    def __init__(
        self,
        name: str,
        joints: Sequence[str],
        limits: Sequence[JointLimits],
        hardware_joints: Sequence[str],
        strict: bool = False,
    ) -> None:
        self.name = name
        self.parameters = Parameters()
        self.joints = tuple(joints)
        self.command_interfaces = position_interfaces(joints)
        self.state_interfaces = tuple(f"{joint}/{name}" for joint in joints for name in ("position", "velocity"))
        self.command: FloatArray = np.full(len(joints), np.nan)
        self._lower = np.array([limit.lower for limit in limits])
        self._upper = np.array([limit.upper for limit in limits])
        self._approach = Approach(limits)
        self._goal = self.command
        """Goals (n,) that the commands approach."""
        self._inbox = Inbox(joints, strict)
        self._settling = Settling(self.joints, limits, indices(joints, hardware_joints))

    @classmethod
    def build(cls, name: str, parameters: ForwardParameters, context: ControllerContext) -> Controller:
        """Build the controller from its parameters and the robot."""
        if not set(parameters.claims()).isdisjoint(context.component.outputs):
            return OutputController.build_as(cls.kind, name, parameters, context)
        if parameters.interface_name != "position":
            return RateCommandController.build_as(cls.kind, name, parameters, context)
        limits = limits_of(parameters.joints, context.limits)
        joints = context.component.joints
        made = cls(name, parameters.joints, limits, joints, parameters.deactivate_on_wrong_length)
        made.parameters = parameters
        return made

    def reconfigure(self, parameters: ForwardParameters) -> None:
        """Reject any change with ValueError, because the settable parameters do not apply to positions."""
        raise ValueError("command_timeout applies only to velocities and efforts, not to positions")

    def submit(self, values: Sequence[float]) -> str | None:
        """Submit a command from any thread. Return None, or the reason why the command is dropped.

        An empty command is ignored.
        """
        return self._inbox.submit(values)

    def activate(self, state: JointState, command: FloatArray) -> None:
        self._inbox.clear()
        self.command = self._goal = command.copy()
        self._approach.begin(command)
        self._settling.begin()

    def deactivate(self, reason: str = "") -> None:
        self._inbox.clear()

    def update(self, state: JointState, now_s: float, period_s: float) -> None:
        wanted = self._inbox.take()
        if wanted is not None:
            self._go(wanted)
        self.command = self._approach.step(self._goal, period_s)
        self._settling.update(self._goal, self.command, state, period_s)

    def rest(self, period_s: float) -> FloatArray:
        """Return the positions (n,) within the limits at which the joints rest or can stop."""
        return np.clip(self._approach.resting_points(period_s), self._lower, self._upper)

    def settled(self) -> bool:
        return self._settling.settled and not self._inbox

    def _go(self, wanted: FloatArray) -> None:
        clipped = np.clip(wanted, self._lower, self._upper)
        if (clipped != wanted).any():
            LOG.warning("%s: %s is outside the limits; the joints move to %s instead", self.name, wanted, clipped)
        if (clipped != self._goal).any():
            self._settling.command_changed()
        self._goal = clipped


class PositionGroupParameters(ForwardParameters):
    """Parameters of a group controller for positions, with a fixed interface."""

    interface_name: Literal["position"] = "position"


class JointGroupPositionController(ForwardCommandController):
    """Forward command controller for positions, under ros2_control's type name."""

    kind: ClassVar[str] = "position_controllers/JointGroupPositionController"
    parameters_type: ClassVar[type[Parameters]] = PositionGroupParameters
    settable: ClassVar[frozenset[str]] = frozenset()


class VelocityGroupParameters(ForwardParameters):
    """Parameters of a group controller for velocities, with a fixed interface."""

    interface_name: Literal["velocity"] = "velocity"


class JointGroupVelocityController(ForwardCommandController):
    """Forward command controller for velocities, under ros2_control's type name."""

    kind: ClassVar[str] = "velocity_controllers/JointGroupVelocityController"
    parameters_type: ClassVar[type[Parameters]] = VelocityGroupParameters


class EffortGroupParameters(ForwardParameters):
    """Parameters of a group controller for efforts, with a fixed interface."""

    interface_name: Literal["effort"] = "effort"


class JointGroupEffortController(ForwardCommandController):
    """Forward command controller for efforts, under ros2_control's type name."""

    kind: ClassVar[str] = "effort_controllers/JointGroupEffortController"
    parameters_type: ClassVar[type[Parameters]] = EffortGroupParameters
