"""Forward the latest message to outputs, such as the LED of a servo."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from controller.forward.commands import ForwardParameters, Inbox
from controller.interface import Controller, ControllerContext
from controller.parameters import Parameters
from hal.outputs import Outputs
from hal.types import FloatArray, JointState

NOTHING: Final[FloatArray] = np.empty(0)


class OutputController:
    """Controller that sets outputs to the values in the latest message. The controller does not move any joints.

    The command of this controller is empty, because the safety gate limits only motions.
    """

    parameters_type: type[Parameters] = ForwardParameters

    def __init__(self, kind: str, name: str, parameters: ForwardParameters, outputs: Outputs) -> None:
        self.kind, self.name = kind, name
        self.parameters = parameters
        self.joints = parameters.joints
        self.command_interfaces = parameters.claims()
        self.state_interfaces: tuple[str, ...] = ()
        self.command: FloatArray = NOTHING
        self._outputs = outputs
        self._inbox = Inbox(parameters.joints, parameters.deactivate_on_wrong_length)

    @classmethod
    def build_as(cls, kind: str, name: str, parameters: ForwardParameters, context: ControllerContext) -> Controller:
        """Build the controller under the type name of another controller."""
        return cls(kind, name, parameters, context.outputs)

    def reconfigure(self, parameters: ForwardParameters) -> None:
        """Reject any change with ValueError, because outputs have no timeout."""
        raise ValueError("command_timeout applies only to velocities and efforts, not to outputs")

    def submit(self, values: Sequence[float]) -> str | None:
        """Submit values from any thread. Return None, or the reason why the values were dropped."""
        return self._inbox.submit(values)

    def activate(self, state: JointState, command: FloatArray) -> None:
        self._inbox.clear()

    def deactivate(self, reason: str = "") -> None:
        self._inbox.clear()

    def update(self, state: JointState, now_s: float, period_s: float) -> None:
        wanted = self._inbox.take()
        if wanted is not None:
            for name, value in zip(self.command_interfaces, wanted.tolist(), strict=True):
                self._outputs.set(name, value)

    def settled(self) -> bool:
        return True
