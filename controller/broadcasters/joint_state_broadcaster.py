"""Implement joint_state_broadcaster/JointStateBroadcaster, which reports the measured joint state."""

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
    """Joint states measured in one cycle. Arrays have shape (n,), with NaN for joints without the state interface."""

    stamp_s: float
    names: tuple[str, ...]
    position: FloatArray
    velocity: FloatArray
    effort: FloatArray


class Sources(BaseModel):
    """State interfaces that provide the three fields of a JointState message."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    position: str = "position"
    velocity: str = "velocity"
    effort: str = "effort"

    def of(self, field: str) -> str:
        """Return the state interface for a message field."""
        return str(getattr(self, field))


class BroadcasterParameters(Parameters):
    """Parameters of a joint state broadcaster, named as in ros2_control.

    As in ros2_control, parameters cannot be changed while the broadcaster is running.
    """

    joints: tuple[str, ...] = ()
    interfaces: tuple[str, ...] = ()
    extra_joints: tuple[str, ...] = ()
    use_local_topics: bool = False
    use_urdf_to_filter: bool = True
    map_interface_to_joint_state: Sources = Sources()
    frame_id: str = "base_link"
    publish_dynamic_joint_states: bool = True

    def unused(self) -> list[str]:
        incomplete = bool(self.joints) != bool(self.interfaces)
        given = "joints" if self.joints else "interfaces"
        unused = [f"{given} (joints and interfaces must be set together)"] if incomplete else []
        requested = self.interfaces if self.joints else ()
        unused += [
            f"map_interface_to_joint_state.{n} ({n} itself is listed in interfaces)"
            for n in MOVEMENT
            if n in requested and self.map_interface_to_joint_state.of(n) != n
        ]
        return super().unused() + unused

    def source(self, field: str) -> str:
        """Return the state interface for a field.

        As in ros2_control, a field that is listed in ``interfaces`` is not remapped.
        """
        return field if self.joints and field in self.interfaces else self.map_interface_to_joint_state.of(field)

    def chosen(self, available: Mapping[str, Sequence[str]]) -> dict[str, tuple[str, ...]]:
        """Return joints and their interfaces in message order. Raises ValueError if an interface does not exist."""
        if self.joints and self.interfaces:
            return self._requested(available)
        # ros2_control reads the joints from the URDF model, which sorts them alphabetically.
        names = sorted(available) if self.use_urdf_to_filter else list(available)
        return {name: tuple(available[name]) for name in names}

    def _requested(self, available: Mapping[str, Sequence[str]]) -> dict[str, tuple[str, ...]]:
        requested = [f"{joint}/{name}" for joint in self.joints for name in self.interfaces]
        existing = [f"{joint}/{name}" for joint, names in available.items() for name in names]
        missing = [name for name in requested if name not in existing]
        if missing:
            raise ValueError(
                f"the URDF has no state interface {', '.join(missing)}: add it to the URDF or remove it from joints "
                f"and interfaces (the URDF has {', '.join(existing)})"
            )
        return dict.fromkeys(self.joints, self.interfaces)


class JointStateBroadcaster:
    """Broadcaster of joint states, which does not claim any joints. Mimic joints are computed from the joints that they
    mimic."""

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
        """Create a broadcaster.

        Args:
            name: Name of the controller.
            parameters: Parameters of the controller.
            state_interfaces: Available state interfaces of each joint, keyed by joint name.
            mimics: Mimic rule of each mimic joint, keyed by joint name.
            hardware_joints: Joint names in hardware order.
            limits: Limits of each joint, keyed by joint name.

        Raises:
            ValueError: The parameters request interfaces that do not exist.
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
        """Complete joint state of the latest cycle, or None while the broadcaster is inactive."""
        chosen = parameters.chosen(state_interfaces)
        self.state_interfaces = tuple(f"{joint}/{name}" for joint, own in chosen.items() for name in own)
        extra = {joint: MOVEMENT for joint in parameters.extra_joints if joint not in chosen}
        self.interfaces: Mapping[str, tuple[str, ...]] = {**chosen, **extra}
        """Interfaces of each joint, in message order."""
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
        """Build the controller from its parameters and the robot."""
        component = context.component
        mimics = {
            name: joint.mimic
            for name, joint in context.description.joints.items()
            if joint.mimic and name in component.mimics
        }
        sensors = {name: sensor.interfaces for name, sensor in component.sensors.items()}
        sources = {name: Mimic(s.joint, 1.0, 0.0) for name, s in component.sensors.items() if s.joint}
        states = {**component.state_interfaces, **sensors}
        return cls(name, parameters, states, {**mimics, **sources}, component.joints, context.limits)

    def activate(self, state: JointState, command: FloatArray) -> None:
        self.state = None

    def deactivate(self, reason: str = "") -> None:
        self.state = None

    def update(self, state: JointState, now_s: float, period_s: float) -> None:
        self.state = state

    def settled(self) -> bool:
        return True

    # The ROS thread calls the following methods, so they do not delay the loop.

    def sample(self, state: JointState) -> JointStates:
        """Return the values to publish for one cycle. The values are computed once and shared by all nodes."""
        if self._latest is None or self._latest.stamp_s != state.stamp_s:
            state = replace(state, position=self._at_limits(state.position))
            self._latest = JointStates(state.stamp_s, self.names, *(column(state) for column in self._columns))
        return self._latest

    def _at_limits(self, position: FloatArray) -> FloatArray:
        """Clip positions that are slightly beyond a limit to that limit.

        A joint that was commanded to a limit can come to rest slightly beyond it, because of sag and the encoder's
        resolution.
        Planners (MoveIt's CheckStartStateBounds) do not start from positions outside the limits. ``values`` still
        returns the measured positions.
        """
        inside = np.clip(position, self._lower, self._upper)
        return np.where(np.abs(inside - position) <= self._slack, inside, position)

    def values(self, state: JointState) -> list[list[float]]:
        """Return the values of every interface of every joint, in the order of ``interfaces``."""
        return [[read(state) for read in own] for own in self._readers] + self._zeros


class _Column:
    """One field of a JointState message, filled from one state interface of all joints.

    The value is NaN for a joint without this interface.
    """

    def __init__(
        self,
        interface: str,
        joints: Mapping[str, Sequence[str]],
        mimics: Mapping[str, Mimic],
        hardware_joints: Sequence[str],
        zeros: int,
    ) -> None:
        """Create a column for ``joints`` and their interfaces. ``zeros`` is the number of zeros to append."""
        self._interface = interface
        self._count, self._size = len(joints), len(joints) + zeros
        following = [mimics.get(joint, Mimic(joint, 1.0, 0.0)) for joint in joints]
        has = [interface in own for own in joints.values()]
        known = all(mimic.joint in hardware_joints for mimic in following)
        self._readers: list[Reader] | None = None
        if interface in MOVEMENT and known:
            effort = interface == "effort"  # A mimic joint reports the effort of the joint that it mimics.
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
