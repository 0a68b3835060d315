"""Implement servoloop/ServoStateBroadcaster, which reports servo states as numbers, not text."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from controller.broadcasters.state_values import SERVO, reader
from controller.interface import ControllerContext
from controller.parameters import Parameters
from hal.plausible import Rate
from hal.types import FloatArray, JointState

ROUNDING = 1e-6
"""Tolerance for comparing times, in periods. This tolerance prevents a rounding error from delaying a due cycle."""


class ServoStateParameters(Parameters):
    """Parameters of a servo state broadcaster."""

    joints: tuple[str, ...] = ()
    """Joints to report. An empty list selects all joints."""
    interfaces: tuple[str, ...] = ()
    """Interfaces to report. An empty list selects all interfaces."""
    rate: Rate = 1.0
    """Rate in Hz. 0 means every cycle."""


class ServoStateBroadcaster:
    """Broadcaster of servo states, which does not claim any joints. Values are computed only when a node calls
    ``values``."""

    kind: ClassVar[str] = "servoloop/ServoStateBroadcaster"
    parameters_type: ClassVar[type[Parameters]] = ServoStateParameters
    settable: ClassVar[frozenset[str]] = frozenset({"rate"})

    def __init__(self, name: str, parameters: ServoStateParameters, hardware_joints: Sequence[str]) -> None:
        """Create a broadcaster. Raises ValueError if the parameters specify unknown joints or interfaces."""
        self.name = name
        self.parameters = parameters
        self.command_interfaces: tuple[str, ...] = ()
        self.state_interfaces: tuple[str, ...] = ()
        self.command: FloatArray = np.empty(0)
        self.state: JointState | None = None
        """Latest state to publish, or None while the broadcaster is inactive."""
        joints = _chosen("joints", parameters.joints, hardware_joints)
        names = _chosen("interfaces", parameters.interfaces, SERVO)
        self.interfaces: Mapping[str, tuple[str, ...]] = dict.fromkeys(joints, names)
        """Interfaces of each joint, in message order."""
        self._readers = [[reader(joint, name, hardware_joints) for name in names] for joint in joints]
        self._since_s = 0.0

    @classmethod
    def build(cls, name: str, parameters: ServoStateParameters, context: ControllerContext) -> "ServoStateBroadcaster":
        """Build the controller from its parameters and the robot."""
        return cls(name, parameters, context.component.joints)

    def reconfigure(self, parameters: ServoStateParameters) -> None:
        """Set the rate."""
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
        """Return all values of every joint, in the order of ``interfaces``.

        The values of joints without a servo are NaN.
        """
        return [[read(state) for read in own] for own in self._readers]


def _chosen(parameter: str, requested: Sequence[str], existing: Sequence[str]) -> tuple[str, ...]:
    unknown = [name for name in requested if name not in existing]
    if unknown:
        raise ValueError(f"{parameter} has unknown entries {', '.join(unknown)}: choose from {', '.join(existing)}")
    return tuple(requested or existing)
