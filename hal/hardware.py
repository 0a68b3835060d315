"""The hardware's seam: the calls that every kind of hardware offers, in ros2_control's component life cycle."""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from hal.lifecycle import LifecycleState
from hal.types import JointCommand, JointState


class Hardware(Protocol):
    """The second seam: where joints leave. Called from one thread.

    configure: UNCONFIGURED → INACTIVE, opens and checks; nothing moves and torque stays as it was.
    activate: INACTIVE → ACTIVE, torque on with the goal at the measured position.
    deactivate: ACTIVE → INACTIVE; ``relax`` lets go of the joints, else they hold where they are.
    cleanup: → UNCONFIGURED, gives everything back; allowed in every state.
    """

    @property
    def name(self) -> str: ...
    @property
    def joints(self) -> tuple[str, ...]: ...
    @property
    def command_interfaces(self) -> tuple[str, ...]:
        """The meaning of a command's values, in their order: ``joint1/position`` and so on."""
        ...

    @property
    def state(self) -> LifecycleState: ...
    def configure(self) -> None: ...
    def activate(self) -> None: ...
    def deactivate(self, relax: bool) -> Sequence[str]:
        """Stop driving the joints; returns what went wrong on the way, each with the servo's name."""
        ...

    def cleanup(self) -> None: ...
    def read(self) -> JointState:
        """Measure the joints. Raises LifecycleError while unconfigured: there is nothing to look at."""
        ...

    def write(self, command: JointCommand) -> None:
        """Command the joints. Raises PartLost where some cannot be reached, another DriverError where none can."""
        ...


@runtime_checkable
class Requesting(Protocol):
    """Hardware that can ask before it is read: all components ask first, and so wait at the same time."""

    def request(self, deadline_s: float | None) -> None:
        """Ask for what the coming ``read`` returns; that waits until ``deadline_s`` on the component's clock.

        None: as long as the component thinks fit.
        """
        ...


@runtime_checkable
class DoubtingLeaps(Protocol):
    """Hardware that itself takes a position that its joint cannot have reached for not measured.

    Of all other hardware the joints' velocity limits say what is believed (hal.leaps).
    """

    doubts_leaps: bool


@runtime_checkable
class Reactivating(Protocol):
    """Hardware whose joints can lose their torque one by one while it is active, and get it back."""

    @property
    def without_torque(self) -> frozenset[str]:
        """The joints of active hardware that get no commands until they are activated again."""
        ...

    def reactivate(self) -> frozenset[str]:
        """Activate these joints while the others hold; returns their names.

        Raises what ``activate`` raises. The hardware stays active then, and the joints without torque.
        """
        ...


@runtime_checkable
class AskedForTorque(Protocol):
    """Reactivating hardware that learns of lost torque only by asking, and asks its joints in turn."""

    def ask_for_torque(self) -> frozenset[str]:
        """Ask all joints of the active hardware now; ``without_torque`` is up to date then.

        Returns the joints that gave no answer. Called between two cycles: it may take as long as a late cycle.
        """
        ...


@runtime_checkable
class Holding(Protocol):
    """Hardware whose joints may have torque although it is inactive: a program that was lost left them so."""

    def holds(self) -> bool:
        """Whether a joint of the configured hardware has torque. Raises DriverError."""
        ...


@runtime_checkable
class Undoing(Protocol):
    """Hardware that can tell which joints had torque before its activation."""

    def undo_activation(self) -> Sequence[str]:
        """ACTIVE → INACTIVE: release the joints that had no torque before; returns what went wrong."""
        ...


def undo_activation(hardware: Hardware) -> Sequence[str]:
    """Take back an activation after which something else failed; returns what went wrong."""
    return hardware.undo_activation() if isinstance(hardware, Undoing) else hardware.deactivate(relax=True)
