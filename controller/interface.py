"""What a controller is to the manager, and what a controller may ask of the others."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from controller.parameters import Parameters
from hal.description import Component, Description
from hal.types import FloatArray, JointLimits, JointState

Settled = Callable[[str], bool]
"""Whether the controller of that name has brought its joints where they were told to be."""


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What a controller is built into."""

    description: Description
    component: Component
    limits: Mapping[str, JointLimits]
    """By joint."""
    settled: Settled


class ControllerType(Protocol):
    """A plug-in: the class of a controller. ``kind`` is its ``type`` in the controllers file."""

    kind: str
    parameters_type: type[Parameters]

    def build(self, name: str, parameters: Any, surroundings: Surroundings) -> "Controller":
        """A class method. ``parameters`` is a checked ``parameters_type``. Raises ValueError, saying what to mend."""
        ...


class Controller(Protocol):
    """Runs in the loop's thread. No I/O, no waiting: called once a cycle.

    ``command_interfaces`` (``joint1/position``) is what it claims while it is active, ``command`` their values
    (shape (n,); rad, m) for the end of the coming period. ``state_interfaces`` is what it looks at.
    """

    @property
    def name(self) -> str: ...
    @property
    def parameters(self) -> Parameters: ...
    @property
    def kind(self) -> str:
        """The plug-in's type, as in the controllers file."""
        ...

    @property
    def command_interfaces(self) -> tuple[str, ...]: ...
    @property
    def state_interfaces(self) -> tuple[str, ...]: ...
    @property
    def command(self) -> FloatArray: ...

    def activate(self, state: JointState, command: FloatArray) -> None:
        """Take over where the joints are: ``command`` (n,) is what the hardware was last told."""
        ...

    def deactivate(self, reason: str = "") -> None:
        """Give up what is under way, in words to its client. ``reason``: why, where nobody asked for it."""
        ...

    def update(self, state: JointState, now_s: float, period_s: float) -> None:
        """One cycle."""
        ...

    def settled(self) -> bool:
        """Whether its joints are where they were told to be, or can go no further."""
        ...


def indices(joints: Sequence[str], among: Sequence[str]) -> list[int]:
    """Where each joint stands in the hardware's order."""
    return [among.index(name) for name in joints]


def limits_of(joints: Sequence[str], limits: Mapping[str, JointLimits]) -> tuple[JointLimits, ...]:
    """Limits in the order of ``joints``."""
    return tuple(limits[name] for name in joints)
