"""joint_state_broadcaster/JointStateBroadcaster: the measured state, by joint and interface."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from pydantic import BaseModel, ConfigDict

from controller.broadcasters.state_values import MOVEMENT, Reader, reader
from controller.interface import ControllerContext
from controller.parameters import Parameters
from hal.robot_description.description import Mimic
from hal.types import AT_LIMIT, FloatArray, JointLimits, JointState


@dataclass(frozen=True, slots=True)
class JointStates:
    """One sample; arrays of full length (n,), NaN where a joint has no such state interface."""

    stamp_s: float
    names: tuple[str, ...]
    position: FloatArray
    velocity: FloatArray
    effort: FloatArray


class Sources(BaseModel):
    """The state interfaces that fill the three fields of a JointState."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    position: str = "position"
    velocity: str = "velocity"
    effort: str = "effort"

    def of(self, field: str) -> str:
        """The state interface, by the name of the field."""
        return str(getattr(self, field))


class BroadcasterParameters(Parameters):
    """Parameters of a joint state broadcaster, under upstream's names; none can be set while it runs, as upstream."""

    joints: tuple[str, ...] = ()
    interfaces: tuple[str, ...] = ()
    extra_joints: tuple[str, ...] = ()
    use_local_topics: bool = False
    use_urdf_to_filter: bool = True
    map_interface_to_joint_state: Sources = Sources()
    frame_id: str = "base_link"
    publish_dynamic_joint_states: bool = True

    def unused(self) -> list[str]:
        lonely = bool(self.joints) != bool(self.interfaces)
        alone = "joints" if self.joints else "interfaces"
        told = [f"{alone} (only joints and interfaces together choose)"] if lonely else []
        asked = self.interfaces if self.joints else ()
        told += [
            f"map_interface_to_joint_state.{n} ({n} itself is among interfaces)"
            for n in MOVEMENT
            if n in asked and self.map_interface_to_joint_state.of(n) != n
        ]
        return super().unused() + told

    def source(self, field: str) -> str:
        """The state interface that fills ``field``: its own where it is asked for by name, as upstream."""
        return field if self.joints and field in self.interfaces else self.map_interface_to_joint_state.of(field)

    def chosen(self, available: Mapping[str, Sequence[str]]) -> dict[str, tuple[str, ...]]:
        """Joints and interfaces, in the order of the messages. Raises ValueError where one is not there."""
        if self.joints and self.interfaces:
            return self._asked_for(available)
        # Upstream takes the joints from the URDF's model, which keeps them in alphabetical order.
        names = sorted(available) if self.use_urdf_to_filter else list(available)
        return {name: tuple(available[name]) for name in names}

    def _asked_for(self, available: Mapping[str, Sequence[str]]) -> dict[str, tuple[str, ...]]:
        asked = [f"{joint}/{name}" for joint in self.joints for name in self.interfaces]
        there = [f"{joint}/{name}" for joint, names in available.items() for name in names]
        missing = [name for name in asked if name not in there]
        if missing:
            raise ValueError(
                f"{', '.join(missing)} is no state interface of the URDF: add it there, or take it out of joints "
                f"and interfaces (there are {', '.join(there)})"
            )
        return dict.fromkeys(self.joints, self.interfaces)


class JointStateBroadcaster:
    """The broadcaster claims no joint. Mimic joints follow theirs."""

    kind: ClassVar[str] = "joint_state_broadcaster/JointStateBroadcaster"
    parameters_type: ClassVar[type[Parameters]] = BroadcasterParameters

    def __init__(
        self,
        name: str,
        parameters: BroadcasterParameters,
        state_interfaces: Mapping[str, Sequence[str]],
        mimics: Mapping[str, Mimic],
        hardware_joints: Sequence[str],
        limits: Mapping[str, JointLimits],
    ) -> None:
        """``state_interfaces`` that there are, and ``limits``, by joint.

        Raises ValueError where the parameters want interfaces that there are not.
        """
        found = [limits.get(joint) for joint in hardware_joints]
        self._lower = np.array([limit.lower if limit else -math.inf for limit in found])
        self._upper = np.array([limit.upper if limit else math.inf for limit in found])
        self._slack = AT_LIMIT * (self._upper - self._lower)
        self.name = name
        self.parameters = parameters
        self.command_interfaces: tuple[str, ...] = ()
        self.command: FloatArray = np.empty(0)
        self.state: JointState | None = None
        """The newest one, whole."""
        chosen = parameters.chosen(state_interfaces)
        self.state_interfaces = tuple(f"{joint}/{name}" for joint, own in chosen.items() for name in own)
        extra = {joint: MOVEMENT for joint in parameters.extra_joints if joint not in chosen}
        self.interfaces: Mapping[str, tuple[str, ...]] = {**chosen, **extra}
        """By joint, in the order of the messages."""
        self._readers = [
            [reader(joint, name, hardware_joints, mimics.get(joint)) for name in own] for joint, own in chosen.items()
        ]
        self._zeros = [[0.0] * len(MOVEMENT)] * len(extra)
        sources = {field: parameters.source(field) for field in MOVEMENT}
        moving = {joint: own for joint, own in chosen.items() if set(own) & set(sources.values())}
        self.names = (*moving, *extra)
        self._columns = [_Column(source, moving, mimics, hardware_joints, len(extra)) for source in sources.values()]
        self._latest: JointStates | None = None

    @classmethod
    def build(cls, name: str, parameters: BroadcasterParameters, context: ControllerContext) -> "JointStateBroadcaster":
        """Build the controller as the controllers file asks."""
        component = context.component
        mimics = {
            name: joint.mimic
            for name, joint in context.description.joints.items()
            if joint.mimic and name in component.mimics
        }
        return cls(name, parameters, component.state_interfaces, mimics, component.joints, context.limits)

    def activate(self, state: JointState, command: FloatArray) -> None:
        self.state = None

    def deactivate(self, reason: str = "") -> None:
        self.state = None

    def update(self, state: JointState, now_s: float, period_s: float) -> None:
        self.state = state

    def settled(self) -> bool:
        return True

    # Called from the ROS thread, so that the loop does not pay for it.

    def sample(self, state: JointState) -> JointStates:
        """The values to publish of one cycle's state; computed once for all nodes that ask."""
        if self._latest is None or self._latest.stamp_s != state.stamp_s:
            state = replace(state, position=self._at_limits(state.position))
            self._latest = JointStates(state.stamp_s, self.names, *(column(state) for column in self._columns))
        return self._latest

    def _at_limits(self, position: FloatArray) -> FloatArray:
        """A joint that was sent to its limit rests a little beyond, by sag and the encoder's steps: it is at the limit.

        Planners (MoveIt's CheckStartStateBounds) refuse to begin outside. ``values`` has what was measured.
        """
        inside = np.clip(position, self._lower, self._upper)
        return np.where(np.abs(inside - position) <= self._slack, inside, position)

    def values(self, state: JointState) -> list[list[float]]:
        """The values of every interface of every joint, in the order of ``interfaces``."""
        return [[read(state) for read in own] for own in self._readers] + self._zeros


class _Column:
    """One field of a JointState: from one state interface of all joints, NaN where a joint has it not."""

    def __init__(
        self,
        interface: str,
        joints: Mapping[str, Sequence[str]],
        mimics: Mapping[str, Mimic],
        hardware_joints: Sequence[str],
        zeros: int,
    ) -> None:
        """``joints`` with their interfaces; after them come so many ``zeros``."""
        self._interface = interface
        self._count, self._size = len(joints), len(joints) + zeros
        following = [mimics.get(joint, Mimic(joint, 1.0, 0.0)) for joint in joints]
        has = [interface in own for own in joints.values()]
        known = all(mimic.joint in hardware_joints for mimic in following)
        self._readers: list[Reader] | None = None
        if interface in MOVEMENT and known:
            effort = interface == "effort"  # a follower shows its leader's
            factors = [1.0 if effort else mimic.multiplier for mimic in following]
            self._index = np.array([list(hardware_joints).index(mimic.joint) for mimic in following], dtype=np.intp)
            self._factor = np.where(has, factors, np.nan)
            self._offset = np.array([mimic.offset if interface == "position" else 0.0 for mimic in following])
        else:
            self._readers = [
                reader(joint, interface, hardware_joints, mimics.get(joint)) if interface in own else _unknown
                for joint, own in joints.items()
            ]

    def __call__(self, state: JointState) -> FloatArray:
        column = np.zeros(self._size)
        if self._readers is None:
            column[: self._count] = getattr(state, self._interface)[self._index] * self._factor + self._offset
        else:
            column[: self._count] = [read(state) for read in self._readers]
        return column


def _unknown(state: JointState) -> float:
    return math.nan
