"""servoloop/ServoStateBroadcaster: the servos' state in numbers. ``/diagnostics`` has the same in words."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from controller.broadcasters.state_values import SERVO, reader
from controller.interface import ControllerContext
from controller.parameters import Parameters
from hal.plausible import Rate
from hal.types import FloatArray, JointState

ROUNDING = 1e-6
"""Rounding of times, in periods: a cycle that is due is not put off for the last digit."""


class ServoStateParameters(Parameters):
    """Parameters of a servo state broadcaster."""

    joints: tuple[str, ...] = ()
    """None: all."""
    interfaces: tuple[str, ...] = ()
    """None: all."""
    rate: Rate = 1.0
    """Hz; 0: every cycle."""


class ServoStateBroadcaster:
    """The broadcaster claims no joint. It shows a state at ``rate``; values are made when a node asks for them."""

    kind: ClassVar[str] = "servoloop/ServoStateBroadcaster"
    parameters_type: ClassVar[type[Parameters]] = ServoStateParameters
    settable: ClassVar[frozenset[str]] = frozenset({"rate"})

    def __init__(self, name: str, parameters: ServoStateParameters, hardware_joints: Sequence[str]) -> None:
        """Raises ValueError where the parameters name joints or interfaces that are not there."""
        self.name = name
        self.parameters = parameters
        self.command_interfaces: tuple[str, ...] = ()
        self.state_interfaces: tuple[str, ...] = ()
        self.command: FloatArray = np.empty(0)
        self.state: JointState | None = None
        """The newest one that is due to be shown; None while inactive."""
        joints = _chosen("joints", parameters.joints, hardware_joints)
        names = _chosen("interfaces", parameters.interfaces, SERVO)
        self.interfaces: Mapping[str, tuple[str, ...]] = dict.fromkeys(joints, names)
        """By joint, in the order of the messages."""
        self._readers = [[reader(joint, name, hardware_joints) for name in names] for joint in joints]
        self._since_s = 0.0

    @classmethod
    def build(cls, name: str, parameters: ServoStateParameters, context: ControllerContext) -> "ServoStateBroadcaster":
        """Build the controller as the controllers file asks."""
        return cls(name, parameters, context.component.joints)

    def reconfigure(self, parameters: ServoStateParameters) -> None:
        """Another rate."""
        self.parameters = parameters

    def activate(self, state: JointState, command: FloatArray) -> None:
        self.state = None

    def deactivate(self, reason: str = "") -> None:
        self.state = None

    def update(self, state: JointState, now_s: float, period_s: float) -> None:
        rate_hz = self.parameters.rate
        self._since_s += period_s
        if self.state is None or self._since_s * rate_hz >= 1.0 - ROUNDING or not rate_hz:
            self.state, self._since_s = state, 0.0

    def settled(self) -> bool:
        return True

    def values(self, state: JointState) -> list[list[float]]:
        """The values of every interface of every joint, in the order of ``interfaces``; NaN where there is no servo."""
        return [[read(state) for read in own] for own in self._readers]


def _chosen(what: str, asked: Sequence[str], there: Sequence[str]) -> tuple[str, ...]:
    unknown = [name for name in asked if name not in there]
    if unknown:
        raise ValueError(f"{what} names {', '.join(unknown)}: take out what is not among {', '.join(there)}")
    return tuple(asked or there)
