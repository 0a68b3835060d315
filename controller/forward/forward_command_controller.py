"""forward_command_controller/ForwardCommandController and upstream's groups: the newest message is the command."""

import logging
from collections.abc import Sequence
from typing import ClassVar, Literal

import numpy as np

from controller.forward.commands import ForwardParameters, Inbox
from controller.forward.rate_command_controller import RateCommandController
from controller.interface import Controller, ControllerContext, indices, limits_of
from controller.motion import within_reach
from controller.parameters import Parameters
from controller.settling import Settling
from hal.types import FloatArray, JointLimits, JointState

LOG = logging.getLogger("servoloop.controller")


class ForwardCommandController:
    """The controller of positions holds the position until the first message comes; then goes to the newest one.

    The command is a ramp at the joints' velocity limits, and stays at its end.
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
        self.command_interfaces = tuple(f"{joint}/position" for joint in joints)
        self.state_interfaces = tuple(f"{joint}/{name}" for joint in joints for name in ("position", "velocity"))
        self.command: FloatArray = np.full(len(joints), np.nan)
        self._lower = np.array([limit.lower for limit in limits])
        self._upper = np.array([limit.upper for limit in limits])
        self._velocity = np.array([limit.velocity for limit in limits])
        self._goal = self.command
        """Where the command is to come to (n,)."""
        self._inbox = Inbox(joints, strict)
        self._settling = Settling(self.joints, limits, indices(joints, hardware_joints))

    @classmethod
    def build(cls, name: str, parameters: ForwardParameters, context: ControllerContext) -> Controller:
        """Build the controller as the controllers file asks."""
        if parameters.interface_name != "position":
            return RateCommandController.build_as(cls.kind, name, parameters, context)
        limits = limits_of(parameters.joints, context.limits)
        joints = context.component.joints
        made = cls(name, parameters.joints, limits, joints, parameters.deactivate_on_wrong_length)
        made.parameters = parameters
        return made

    def reconfigure(self, parameters: ForwardParameters) -> None:
        """Raises ValueError: settable parameters are not for positions."""
        raise ValueError("a position is held: command_timeout is for velocities and efforts")

    def submit(self, values: Sequence[float]) -> str | None:
        """A command from any thread. Returns why it is dropped, or None; empty ones mean nothing."""
        return self._inbox.submit(values)

    def activate(self, state: JointState, command: FloatArray) -> None:
        self._inbox.clear()
        self.command = self._goal = command.copy()
        self._settling.begin()

    def deactivate(self, reason: str = "") -> None:
        self._inbox.clear()

    def update(self, state: JointState, now_s: float, period_s: float) -> None:
        wanted = self._inbox.take()
        if wanted is not None:
            self._go(wanted)
        self.command = within_reach(self._goal, self.command, self._velocity, period_s)
        self._settling.update(self._goal, self.command, state, period_s)

    def settled(self) -> bool:
        return self._settling.settled and not self._inbox

    def _go(self, wanted: FloatArray) -> None:
        clipped = np.clip(wanted, self._lower, self._upper)
        if (clipped != wanted).any():
            LOG.warning("%s: %s is outside the limits, going to %s", self.name, wanted, clipped)
        if (clipped != self._goal).any():
            self._settling.command_changed()
        self._goal = clipped


class PositionGroupParameters(ForwardParameters):
    """The interface goes without saying."""

    interface_name: Literal["position"] = "position"


class JointGroupPositionController(ForwardCommandController):
    """Upstream's name for a forward command controller of positions."""

    kind: ClassVar[str] = "position_controllers/JointGroupPositionController"
    parameters_type: ClassVar[type[Parameters]] = PositionGroupParameters
    settable: ClassVar[frozenset[str]] = frozenset()


class VelocityGroupParameters(ForwardParameters):
    """The interface goes without saying."""

    interface_name: Literal["velocity"] = "velocity"


class JointGroupVelocityController(ForwardCommandController):
    """Upstream's name for a forward command controller of velocities."""

    kind: ClassVar[str] = "velocity_controllers/JointGroupVelocityController"
    parameters_type: ClassVar[type[Parameters]] = VelocityGroupParameters


class EffortGroupParameters(ForwardParameters):
    """The interface goes without saying."""

    interface_name: Literal["effort"] = "effort"


class JointGroupEffortController(ForwardCommandController):
    """Upstream's name for a forward command controller of efforts."""

    kind: ClassVar[str] = "effort_controllers/JointGroupEffortController"
    parameters_type: ClassVar[type[Parameters]] = EffortGroupParameters
