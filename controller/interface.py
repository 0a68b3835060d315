"""The controller interface: the manager's view of a controller, and the context that a controller is built into."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, cast

from controller.parameters import Parameters
from hal.compensation.servo_compliance import Compliance, lags
from hal.robot_description.description import Description, HardwareInfo
from hal.types import FloatArray, JointLimits, JointState

Settled = Callable[[str], bool]
"""Whether the controller of that name has brought its joints to their command."""


@dataclass(frozen=True, slots=True)
class ControllerContext:
    """The robot that a controller is built into, and its other controllers."""

    description: Description
    component: HardwareInfo
    """All ``<ros2_control>`` blocks as one."""
    limits: Mapping[str, JointLimits]
    """The limits, by joint."""
    settled: Settled
    compliances: Mapping[str, Compliance] = field(default_factory=dict)
    """How far servos give way and lag; a joint that is not named follows its command at once."""

    def lags(self, joints: Sequence[str]) -> FloatArray:
        """How far these joints lag, for the trajectory sampler."""
        return lags([self.compliances.get(joint) for joint in joints])


class ControllerType(Protocol):
    """A plug-in: the class of a controller. ``kind`` is its ``type`` in the controllers file."""

    kind: str
    parameters_type: type[Parameters]

    def build(self, name: str, parameters: Any, context: ControllerContext) -> "Controller":
        """A class method. ``parameters`` is a checked ``parameters_type``. Raises ValueError, saying what to mend."""
        ...


class Controller(Protocol):
    """A controller runs in the loop's thread, once a cycle: no I/O, no waiting.

    A controller claims its ``command_interfaces`` (``joint1/position``) while it is active; ``command`` has their
    values (shape (n,); rad, m) for the end of the coming period. It looks at its ``state_interfaces``.
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
        """Take over where the joints are: ``command`` (n,) is the hardware's last command."""
        ...

    def deactivate(self, reason: str = "") -> None:
        """Give up the goal under way, with a result for its client. ``reason``: why, where no client asked for it."""
        ...

    def update(self, state: JointState, now_s: float, period_s: float) -> None:
        """Run one cycle."""
        ...

    def settled(self) -> bool:
        """Whether the controller's joints have arrived at their command, or can go no further."""
        ...


class Relieving(Controller, Protocol):
    """A controller whose joints, once it is deactivated, give way to whatever holds them until they press no more."""

    def begin_relief(self, state: JointState, command: FloatArray) -> None:
        """The joints rest at ``command`` (n,), and no other controller has them."""
        ...

    def relieve(self, state: JointState, now_s: float, period_s: float) -> bool:
        """Run one cycle of the relief, which sets ``command``; returns whether another one is needed."""
        ...


def relieving(controller: Controller) -> Relieving | None:
    """The controller as one that relieves its joints, if it does; it may be wrapped in another object."""
    return cast(Relieving, controller) if hasattr(controller, "begin_relief") else None


def indices(joints: Sequence[str], among: Sequence[str]) -> list[int]:
    """The place of each joint in the hardware's order."""
    return [among.index(name) for name in joints]


def limits_of(joints: Sequence[str], limits: Mapping[str, JointLimits]) -> tuple[JointLimits, ...]:
    """Limits in the order of ``joints``."""
    return tuple(limits[name] for name in joints)
