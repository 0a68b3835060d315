"""The control loop's record of each hardware component: its joints, commands and state."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from drivers.bus.counters import BusCounters
from hal.hardware import Hardware, Reactivating, outputs_of
from hal.lifecycle import LifecycleState
from hal.types import JointFault, JointState, ServoHealth

CONFIGURED = (LifecycleState.INACTIVE, LifecycleState.ACTIVE)


@dataclass(slots=True)
class Component:
    """Record of one hardware component."""

    hardware: Hardware
    joints: slice
    """Indices of the component's joints among the joints of the set."""
    commands: slice
    """Indices of the component's commands among the commands of the set."""
    cycles_per_update: int = 1
    """Number of cycles between two updates of the component."""
    written: bool = True
    """Whether the component has commands or outputs. Otherwise it is only read."""
    switching: bool = False
    """Whether a transition is running in the background. During a transition, the cycle skips the component."""
    leaving: bool = False
    """Whether the joints are coming to rest before a transition. No controller can be activated during this time."""
    error: Exception | None = None
    """Error that caused the loss of the component. The component may still be stopped if it is reachable."""
    out_of_reach: bool = False
    """Whether the last command failed to reach any of the component's joints."""
    finalized: bool = False
    driven: bool = False
    """Whether the component has been active in a cycle since its last transition."""

    @property
    def name(self) -> str:
        return self.hardware.name

    @property
    def state(self) -> LifecycleState:
        """Life cycle state of the component, or FINALIZED if the component can no longer be used."""
        return LifecycleState.FINALIZED if self.finalized else self.hardware.state

    @property
    def sound(self) -> bool:
        """Whether the cycle may read the component: it is configured, not in a transition and not lost."""
        return not self.switching and self.error is None and self.hardware.state in CONFIGURED

    @property
    def active(self) -> bool:
        """Whether controllers may command the component."""
        return self.sound and self.hardware.state is LifecycleState.ACTIVE

    @property
    def incomplete(self) -> bool:
        """Whether joints of the active component must be activated again."""
        return self.active and isinstance(self.hardware, Reactivating) and bool(self.hardware.without_torque)


def components_of(hardware: Sequence[Hardware], cycles_per_update: Sequence[int]) -> Iterator[Component]:
    """Yield a record of each component. Joints and commands of the set follow the order of the components."""
    joints = commands = 0
    for one, cycles in zip(hardware, cycles_per_update, strict=True):
        ends = joints + len(one.joints), commands + len(one.command_interfaces)
        written = bool(one.command_interfaces or outputs_of(one))
        yield Component(one, slice(joints, ends[0]), slice(commands, ends[1]), cycles, written)
        joints, commands = ends


def merged_state(components: Sequence[Component], parts: Mapping[str, JointState], stamp_s: float) -> JointState:
    """Merge the states of all components into one. Joints of an unavailable component get a fault.

    Args:
        components: All components, in the order of their joints.
        parts: State of each component, keyed by component name.
        stamp_s: Time of the merged state, in seconds.
    """
    position, velocity, effort = (np.full(components[-1].joints.stop, np.nan) for _ in range(3))
    faults: dict[str, JointFault] = {}
    health: dict[str, ServoHealth] = {}
    extra: dict[str, float] = {}
    lines: dict[str, BusCounters] = {}
    for component in components:
        part = parts.get(component.name)
        if part is not None:
            position[component.joints] = part.position
            velocity[component.joints] = part.velocity
            effort[component.joints] = part.effort
            health |= part.health
            extra |= part.extra
            lines |= part.lines
            faults |= part.faults
        if not component.sound:
            faults |= dict.fromkeys(component.hardware.joints, JointFault("component", _unavailable_text(component)))
    return JointState(stamp_s, position, velocity, effort, faults, health, extra, lines)


def _unavailable_text(component: Component) -> str:
    if component.error is not None:
        return f"{component.name} is lost: {component.error}"
    return f"{component.name} is {'being switched' if component.switching else component.state.name.lower()}"
