"""Define the hardware, the seam through which joint commands leave, with ros2_control's component life cycle."""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from hal.lifecycle import LifecycleState
from hal.types import JointCommand, JointState


class Hardware(Protocol):
    """Hardware with joints, such as servos, the mock or MuJoCo. Its methods are called from one thread."""

    @property
    def name(self) -> str:
        """Name of the component."""
        ...

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, in order."""
        ...

    @property
    def command_interfaces(self) -> tuple[str, ...]:
        """Names of the values of a command, in order, such as ``joint1/position``."""
        ...

    @property
    def state(self) -> LifecycleState:
        """State in the life cycle."""
        ...

    def configure(self) -> None:
        """Open and check the hardware: UNCONFIGURED → INACTIVE. Nothing moves, and torque stays as it was.

        Raises:
            DriverError: The hardware cannot be opened, or differs from its description.
        """
        ...

    def activate(self) -> None:
        """Enable torque with each goal at the measured position: INACTIVE → ACTIVE.

        Raises:
            ActivationError: A joint cannot be activated safely.
            DriverError: The hardware does not answer.
        """
        ...

    def deactivate(self, relax: bool) -> Sequence[str]:
        """Stop driving the joints: ACTIVE → INACTIVE.

        Args:
            relax: Whether to release the torque. Otherwise the joints hold their positions.

        Returns:
            Messages about errors, each with the name of the servo.
        """
        ...

    def cleanup(self) -> None:
        """Close the hardware: → UNCONFIGURED. This is allowed in every state."""
        ...

    def read(self) -> JointState:
        """Measure the joints.

        Returns:
            The state of all joints.

        Raises:
            LifecycleError: The hardware is unconfigured.
        """
        ...

    def write(self, command: JointCommand) -> None:
        """Command the joints.

        Args:
            command: Values in the order of ``command_interfaces``.

        Raises:
            PartLost: Some joints cannot be reached.
            DriverError: No joint can be reached.
        """
        ...


@runtime_checkable
class Requesting(Protocol):
    """Hardware that can send its requests before it is read, so that all components wait at the same time."""

    def request(self, deadline_s: float | None) -> None:
        """Send the requests whose replies the next ``read`` returns.

        Args:
            deadline_s: Time until which ``read`` waits, in seconds on the component's clock. None lets the component
                decide.
        """
        ...


@runtime_checkable
class DoubtingLeaps(Protocol):
    """Hardware that itself detects positions that a joint cannot have reached.

    For all other hardware, the velocity limits of the joints decide (hal.leaps).
    """

    doubts_leaps: bool
    """Whether the hardware reports such positions itself."""


@runtime_checkable
class Reactivating(Protocol):
    """Hardware whose joints can lose their torque one by one while it is active, and get it back."""

    @property
    def without_torque(self) -> frozenset[str]:
        """Names of the joints that get no commands until they are activated again."""
        ...

    def reactivate(self) -> frozenset[str]:
        """Activate the joints without torque while the others hold.

        Returns:
            The names of the activated joints.

        Raises:
            ActivationError: A joint cannot be activated safely. The hardware stays active, and the joints stay without
                torque.
            DriverError: The hardware does not answer. The state is as for ActivationError.
        """
        ...


@runtime_checkable
class AskedForTorque(Protocol):
    """Reactivating hardware that detects lost torque only by polling its joints in turn."""

    def ask_for_torque(self) -> frozenset[str]:
        """Poll all joints of the active hardware, and update ``without_torque``.

        It is called between two cycles and may take as long as a late cycle.

        Returns:
            The names of the joints that did not answer.
        """
        ...


@runtime_checkable
class Holding(Protocol):
    """Hardware whose joints may have torque although it is inactive, because a former program left them so."""

    def holds(self) -> bool:
        """Return whether a joint of the configured hardware has torque.

        Returns:
            Whether at least one joint has torque.

        Raises:
            DriverError: The hardware cannot be read.
        """
        ...


@runtime_checkable
class Undoing(Protocol):
    """Hardware that knows which joints had torque before its activation."""

    def undo_activation(self) -> Sequence[str]:
        """Release the joints that had no torque before: ACTIVE → INACTIVE.

        Returns:
            Messages about errors.
        """
        ...


def undo_activation(hardware: Hardware) -> Sequence[str]:
    """Undo an activation after which another step failed. Return messages about errors."""
    return hardware.undo_activation() if isinstance(hardware, Undoing) else hardware.deactivate(relax=True)
