"""A user's controller that can be configured to fail. The controller is installed as a plugin in the stack of a
test."""

import logging
import time
from pathlib import Path
from typing import Any, Literal

import numpy as np

from controller.interface import ControllerContext
from controller.parameters import Parameters
from hal.types import FloatArray, JointState

LOG = logging.getLogger("servoloop.controller")


class TroublesomeParameters(Parameters):
    """Parameters of the controller. While the file ``holdup`` exists, ``fault: waits`` blocks the loop."""

    joint: str
    fault: Literal["none", "raises", "too many", "too few", "waits"] = "none"
    holdup: str = ""

    def claims(self) -> tuple[str, ...]:
        return (f"{self.joint}/position",)


class Troublesome:
    """Controller that holds its joint unless a fault is configured."""

    kind = "test/Troublesome"
    parameters_type = TroublesomeParameters
    settable = frozenset({"fault"})

    def __init__(self, name: str, parameters: TroublesomeParameters) -> None:
        self.name, self.parameters = name, parameters
        self.command_interfaces = self.state_interfaces = parameters.claims()
        self.command: FloatArray = np.full(1, np.nan)

    @classmethod
    def build(cls, name: str, parameters: Any, context: ControllerContext) -> "Troublesome":
        return cls(name, parameters)

    def activate(self, state: JointState, command: FloatArray) -> None:
        self.command = command

    def deactivate(self, reason: str = "") -> None: ...

    def update(self, state: JointState, now_s: float, period_s: float) -> None:
        match self.parameters.fault:
            case "raises":
                raise RuntimeError("the gripper's camera is dark")
            case "too many":
                self.command = np.zeros(2)
            case "too few":
                self.command = np.zeros(0)
            case "waits":
                self._wait(Path(self.parameters.holdup))

    def _wait(self, holdup: Path) -> None:
        if holdup.exists():
            LOG.warning("%s holds the loop up", self.name)
        while holdup.exists():
            time.sleep(0.005)

    def settled(self) -> bool:
        return True

    def reconfigure(self, parameters: TroublesomeParameters) -> None:
        self.parameters = parameters
