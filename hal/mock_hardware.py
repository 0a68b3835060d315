"""Mock hardware with the behavior of mock_components/GenericSystem: each state equals the last command."""

from collections.abc import Mapping, Sequence

import numpy as np

from drivers.clock import Clock
from hal.lifecycle import LifecycleState, require, require_configured
from hal.outputs import Outputs
from hal.robot_description.description import HardwareInfo
from hal.types import Interface, JointCommand, JointState, position_interfaces

KINDS = ("position", "velocity", "effort")


class MockHardware:
    """Mock joints that reach each command immediately.

    Each command is copied to the state interface of the same name. The parameters are the same as for GenericSystem:

    - ``calculate_dynamics``: The velocity is the difference quotient of the position commands, and a velocity command
      moves the joint.
    - ``disable_commands``: Commands have no effect.
    """

    def __init__(
        self,
        name: str,
        joints: Sequence[str],
        clock: Clock,
        calculate_dynamics: bool = False,
        command_interfaces: Sequence[str] | None = None,
    ) -> None:
        """Create the mock.

        Args:
            name: Name of the component.
            joints: Names of the joints.
            clock: Clock for the time stamps.
            calculate_dynamics: Whether velocities are computed from positions, and positions from velocity commands.
            command_interfaces: Names of the command interfaces; by default the position of each joint.
        """
        self.name = name
        self.joints = tuple(joints)
        positions = position_interfaces(joints)
        self.command_interfaces = tuple(positions if command_interfaces is None else command_interfaces)
        self.state = LifecycleState.UNCONFIGURED
        self._clock = clock
        self._calculate_dynamics = calculate_dynamics
        self._disable_commands = False
        self._position = np.zeros(len(self.joints))
        self._velocity = np.zeros(len(self.joints))
        self._effort = np.full(len(self.joints), np.nan)
        self._extra: dict[str, float] = {}
        self._outputs = Outputs()
        self.outputs: tuple[str, ...] = ()
        self._reported: list[str] = []
        """Outputs that have a state interface of the same name."""
        self._joints_of = {kind: self._commanded(kind) for kind in KINDS}

    @classmethod
    def of(cls, component: HardwareInfo, clock: Clock, outputs: Outputs | None = None) -> "MockHardware":
        """Create the mock hardware that a ``<ros2_control>`` block describes.

        Args:
            component: The block.
            clock: Clock for the time stamps.
            outputs: Values of the outputs. Each output is copied to the state interface of the same name.
        """
        made = cls(
            component.name,
            component.joints,
            clock,
            component.flag("calculate_dynamics"),
            component.commands,
        )
        made._disable_commands = component.flag("disable_commands")
        made._begin(component.state_interfaces, component.initial_values)
        made.outputs = tuple(component.outputs)
        made._outputs = outputs or Outputs()
        made._reported = [name for name in component.outputs if name in component.states]
        return made

    def _begin(self, states: Mapping[str, Sequence[str]], initial: Mapping[str, float]) -> None:
        """Set the initial values. By default, positions and velocities are 0 and all other states are NaN."""
        arrays = {"position": self._position, "velocity": self._velocity, "effort": self._effort}
        for index, joint in enumerate(self.joints):
            for kind in states.get(joint, ()):
                value = initial.get(f"{joint}/{kind}")
                if kind not in arrays:
                    self._extra[f"{joint}/{kind}"] = np.nan if value is None else value
                elif value is not None:
                    arrays[kind][index] = value

    def _commanded(self, kind: str) -> tuple[list[int], list[int]]:
        """Return the indices of the joints with a command of this type, and the indices of these commands."""
        pairs = [
            (self.joints.index(joint), place)
            for place, (joint, own) in enumerate(map(Interface.parse, self.command_interfaces))
            if own == kind
        ]
        return [joint for joint, _ in pairs], [place for _, place in pairs]

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
        return JointState(
            self._clock.now(),
            self._position.copy(),
            self._velocity.copy(),
            self._effort.copy(),
            extra=self._extra,
        )

    def write(self, command: JointCommand) -> None:
        require(self.state, LifecycleState.ACTIVE, "write")
        if self._disable_commands:
            return
        for name in self._reported:
            if (value := self._outputs.requested(name)) is not None:
                self._extra = {**self._extra, name: value}
        before = self._position.copy()
        for kind, array in (("velocity", self._velocity), ("effort", self._effort)):
            joints, places = self._joints_of[kind]
            array[joints] = command.values[places]
        self._move(command)
        if self._calculate_dynamics:
            self._velocity = (self._position - before) / command.period_s

    def _move(self, command: JointCommand) -> None:
        """Move the joints. A position command overrides the motion that results from a velocity command."""
        if self._calculate_dynamics:
            driven, places = self._joints_of["velocity"]
            self._position[driven] += command.values[places] * command.period_s
        joints, places = self._joints_of["position"]
        self._position[joints] = command.values[places]
