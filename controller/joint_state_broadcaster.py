"""joint_state_broadcaster/JointStateBroadcaster: the measured state, by joint and interface."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from controller.interface import Surroundings
from controller.parameters import Parameters
from hal.description import Mimic
from hal.types import FloatArray, JointState


@dataclass(frozen=True, slots=True)
class JointStates:
    """One sample; arrays of full length, NaN where a joint has no such state interface."""

    stamp_s: float
    names: tuple[str, ...]
    position: FloatArray
    velocity: FloatArray
    effort: FloatArray


class BroadcasterParameters(Parameters):
    """Of a joint state broadcaster: everything is broadcast."""

    def unused(self) -> list[str]:
        return []


class JointStateBroadcaster:
    """Claims nothing. Joints in alphabetical order, as upstream; mimic joints follow theirs."""

    kind: ClassVar[str] = "joint_state_broadcaster/JointStateBroadcaster"
    parameters_type: ClassVar[type[Parameters]] = BroadcasterParameters

    def __init__(
        self,
        name: str,
        state_interfaces: Mapping[str, Sequence[str]],
        mimics: Mapping[str, Mimic],
        hardware_joints: Sequence[str],
    ) -> None:
        self.name = name
        self.parameters = Parameters()
        self.command_interfaces: tuple[str, ...] = ()
        self.state_interfaces = tuple(f"{joint}/{name}" for joint, own in state_interfaces.items() for name in own)
        self.command: FloatArray = np.empty(0)
        self.latest: JointStates | None = None
        self.names = tuple(sorted(state_interfaces))
        sources = [mimics[n].joint if n in mimics else n for n in self.names]
        self._index = [list(hardware_joints).index(source) for source in sources]
        self._factor = np.array([mimics[n].multiplier if n in mimics else 1.0 for n in self.names])
        self._offset = np.array([mimics[n].offset if n in mimics else 0.0 for n in self.names])
        self._masks = {
            kind: np.array([1.0 if kind in state_interfaces[n] else np.nan for n in self.names])
            for kind in ("position", "velocity", "effort")
        }

    @classmethod
    def build(cls, name: str, parameters: BroadcasterParameters, surroundings: Surroundings) -> "JointStateBroadcaster":
        """As the controllers file wants it."""
        component = surroundings.component
        mimics = {
            name: joint.mimic
            for name, joint in surroundings.description.joints.items()
            if joint.mimic and name in component.state_interfaces
        }
        made = cls(name, component.state_interfaces, mimics, component.joints)
        made.parameters = parameters
        return made

    def activate(self, state: JointState, command: FloatArray) -> None:
        self.latest = None

    def deactivate(self) -> None:
        self.latest = None

    def update(self, state: JointState, now_s: float, period_s: float) -> None:
        position = state.position[self._index] * self._factor + self._offset
        self.latest = JointStates(
            state.stamp_s,
            self.names,
            position * self._masks["position"],
            state.velocity[self._index] * self._factor * self._masks["velocity"],
            state.effort[self._index] * self._masks["effort"],
        )

    def settled(self) -> bool:
        return True
