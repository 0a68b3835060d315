"""Interfaces of hardware components, with the life cycle of ros2_control."""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from hal.lifecycle import LifecycleState
from hal.types import JointCommand, JointState


class Hardware(Protocol):
    """Hardware component. All methods are called from one thread."""

    @property
    def name(self) -> str:
        """Name of the component."""
        ...

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, in the order of a measurement."""
        ...

    @property
    def command_interfaces(self) -> tuple[str, ...]:
        """Names of the command interfaces (such as ``joint1/position``), in the order of a command."""
        ...

    @property
    def state(self) -> LifecycleState:
        """Life cycle state."""
        ...

    def configure(self) -> None:
        """Open and check the hardware (UNCONFIGURED → INACTIVE). Nothing moves, and torque stays as it is.

        Raises:
            LifecycleError: The component is not unconfigured.
            DriverError: The hardware could not be opened, or a check failed.
        """
        ...

    def activate(self) -> None:
        """Enable torque with each goal at the measured position (INACTIVE → ACTIVE).

        Raises:
            LifecycleError: The component is not inactive.
            ActivationError: A joint must not have torque now.
            DriverError: The hardware could not be reached.
        """
        ...

    def deactivate(self, relax: bool) -> Sequence[str]:
        """Stop driving the joints (ACTIVE → INACTIVE).

        Args:
            relax: Whether to disable torque. Otherwise the joints hold their positions.

        Returns:
            Descriptions of errors, each with the servo's ID.

        Raises:
            LifecycleError: The component is not active.
        """
        ...

    def cleanup(self) -> None:
        """Close the hardware (any state → UNCONFIGURED)."""
        ...

    def read(self) -> JointState:
        """Measure the joints.

        Returns:
            The measurement, with arrays in the order of ``joints``.

        Raises:
            LifecycleError: The component is unconfigured.
            DriverError: The hardware could not be reached.
        """
        ...

    def write(self, command: JointCommand) -> None:
        """Send a command to the joints.

        Args:
            command: Values of shape (m,), in the order of ``command_interfaces``.

        Raises:
            LifecycleError: The component is not active.
            PartLost: Some joints could not be reached.
            DriverError: None of the joints could be reached.
        """
        ...


@runtime_checkable
class Requesting(Protocol):
    """Hardware that can send its request before it is read.

    All components send their requests first, so that they wait for the answers at the same time.
    """

    def request(self, deadline_s: float | None) -> None:
        """Request the measurement that the next ``read`` returns.

        Args:
            deadline_s: Time on the component's clock until which ``read`` waits, in seconds; None if the component
                chooses it.

        Raises:
            DriverError: The hardware could not be reached.
        """
        ...


@runtime_checkable
class DoubtingLeaps(Protocol):
    """Hardware with its own check of whether a joint can have reached the measured position.

    For all other hardware, ``LeapFilter`` makes this check with the velocity limits of the joints.
    """

    doubts_leaps: bool


@runtime_checkable
class Reactivating(Protocol):
    """Active hardware that can enable the torque of single joints again."""

    @property
    def without_torque(self) -> frozenset[str]:
        """Joints of the active hardware that lost their torque and get no commands until they are activated again."""
        ...

    def reactivate(self) -> frozenset[str]:
        """Activate the joints without torque while the others hold their positions.

        If this fails, the hardware stays active and the joints stay without torque.

        Returns:
            The names of the joints.

        Raises:
            ActivationError, DriverError: As for ``activate``.
        """
        ...


@runtime_checkable
class AskedForTorque(Protocol):
    """Hardware that must poll its joints for lost torque. It polls them in turn, a few in each cycle."""

    def ask_for_torque(self) -> frozenset[str]:
        """Poll all joints of the active hardware now and update ``without_torque``.

        The method is called between two cycles, and may take as long as a late cycle.

        Returns:
            The joints that did not answer.
        """
        ...


@runtime_checkable
class Holding(Protocol):
    """Hardware whose joints may have torque while it is inactive, for example after another program crashed."""

    def holds(self) -> bool:
        """Return whether a joint of the configured hardware has torque. Raises DriverError."""
        ...


@runtime_checkable
class Undoing(Protocol):
    """Hardware that remembers which joints had torque before its activation."""

    def undo_activation(self) -> Sequence[str]:
        """Release the joints that had no torque before the activation (ACTIVE → INACTIVE). Return the errors."""
        ...


def undo_activation(hardware: Hardware) -> Sequence[str]:
    """Undo the activation of a component because a later step failed. Return the errors."""
    return hardware.undo_activation() if isinstance(hardware, Undoing) else hardware.deactivate(relax=True)
