"""The loop's record of one hardware component: its part of the whole, and whether it can be used."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from drivers.bus.counters import BusCounters
from hal.hardware import Hardware, Reactivating
from hal.lifecycle import LifecycleState
from hal.types import JointFault, JointState, ServoHealth

CONFIGURED = (LifecycleState.INACTIVE, LifecycleState.ACTIVE)


@dataclass(slots=True)
class Component:
    """A component's record: ``joints`` and ``commands`` are its part of the whole set's."""

    hardware: Hardware
    joints: slice
    commands: slice
    cycles_per_update: int = 1
    """The component is read and written once in so many cycles."""
    switching: bool = False
    """A transition changes its state just now, in the background: the cycle leaves it alone."""
    error: Exception | None = None
    """Why it is lost, or by what defect. It may still be told to stop, as far as it can be reached."""
    out_of_reach: bool = False
    """The last command reached nobody."""
    finalized: bool = False
    driven: bool = False
    """The component has been active in a cycle, and nobody has changed its state since."""

    @property
    def name(self) -> str:
        return self.hardware.name

    @property
    def state(self) -> LifecycleState:
        """The life cycle state as the component says; FINALIZED, which comes from outside, is the last word."""
        return LifecycleState.FINALIZED if self.finalized else self.hardware.state

    @property
    def sound(self) -> bool:
        """Whether the cycle may read it: it is configured, not being switched and not lost."""
        return not self.switching and self.error is None and self.hardware.state in CONFIGURED

    @property
    def active(self) -> bool:
        """Whether controllers may command it."""
        return self.sound and self.hardware.state is LifecycleState.ACTIVE

    @property
    def incomplete(self) -> bool:
        """Whether joints of the active component have to be activated again."""
        return self.active and isinstance(self.hardware, Reactivating) and bool(self.hardware.without_torque)


def components_of(hardware: Sequence[Hardware], cycles_per_update: Sequence[int]) -> Iterator[Component]:
    """Records of components whose joints and commands stand one behind the other; ``cycles_per_update`` of each."""
    joints = commands = 0
    for one, cycles in zip(hardware, cycles_per_update, strict=True):
        ends = joints + len(one.joints), commands + len(one.command_interfaces)
        yield Component(one, slice(joints, ends[0]), slice(commands, ends[1]), cycles)
        joints, commands = ends


def merged_state(components: Sequence[Component], parts: Mapping[str, JointState], stamp_s: float) -> JointState:
    """Put the components' states (by component name) together; joints that are not measured now have a fault."""
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
            faults |= dict.fromkeys(component.hardware.joints, JointFault("component", _absence(component)))
    return JointState(stamp_s, position, velocity, effort, faults, health, extra, lines)


def _absence(component: Component) -> str:
    """Why there is nothing new of a component's joints."""
    if component.error is not None:
        return f"{component.name} is lost: {component.error}"
    return f"{component.name} is {'being switched' if component.switching else component.state.name.lower()}"
