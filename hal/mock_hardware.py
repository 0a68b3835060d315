"""What mock_components/GenericSystem does: the position is the command."""

from collections.abc import Sequence

import numpy as np

from drivers.clock import Clock
from hal.lifecycle import LifecycleState, require, require_configured
from hal.types import JointCommand, JointState


class MockHardware:
    """Joints that are at once where they are told to be.

    ``calculate_dynamics`` is GenericSystem's parameter: the velocity is the difference quotient of
    the commands; without it the velocity stays 0.
    """

    def __init__(self, name: str, joints: Sequence[str], clock: Clock, calculate_dynamics: bool = False) -> None:
        self.name = name
        self.joints = tuple(joints)
        self.state = LifecycleState.UNCONFIGURED
        self._clock = clock
        self._calculate_dynamics = calculate_dynamics
        self._position = np.zeros(len(self.joints))
        self._velocity = np.zeros(len(self.joints))

    def configure(self) -> None:
        require(self.state, LifecycleState.UNCONFIGURED, "configure")
        self.state = LifecycleState.INACTIVE

    def activate(self) -> None:
        require(self.state, LifecycleState.INACTIVE, "activate")
        self.state = LifecycleState.ACTIVE

    def deactivate(self, relax: bool) -> Sequence[str]:
        require(self.state, LifecycleState.ACTIVE, "deactivate")
        self.state = LifecycleState.INACTIVE
        return []

    def cleanup(self) -> None:
        self.state = LifecycleState.UNCONFIGURED

    def read(self) -> JointState:
        require_configured(self.state, "read")
        unknown = np.full(len(self.joints), np.nan)
        return JointState(self._clock.now(), self._position.copy(), self._velocity.copy(), unknown)

    def write(self, command: JointCommand) -> None:
        require(self.state, LifecycleState.ACTIVE, "write")
        if self._calculate_dynamics:
            self._velocity = (command.position - self._position) / command.period_s
        self._position = command.position.copy()
