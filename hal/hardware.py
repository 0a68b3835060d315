"""Interfaces of hardware components, with the life cycle used by ros2_control."""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from hal.lifecycle import LifecycleState
from hal.types import JointCommand, JointState


class Hardware(Protocol):
    """Hardware component. All methods are called from the same thread."""

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
        """Open and check the hardware: UNCONFIGURED → INACTIVE. Nothing moves, and torque is neither enabled nor
        disabled.

        Raises:
            DriverError: The hardware cannot be opened, or does not match its description.
        """
        ...

    def activate(self) -> None:
        """Enable torque after setting each goal to the measured position: INACTIVE → ACTIVE.

        Raises:
            ActivationError: A joint cannot be activated safely.
            DriverError: The hardware does not respond.
        """
        ...

    def deactivate(self, relax: bool) -> Sequence[str]:
        """Stop driving the joints: ACTIVE → INACTIVE.

        Args:
            relax: Whether to disable the torque. If False, the joints hold their positions.

        Returns:
            Error messages, each with the name of the servo.
        """
        ...

    def cleanup(self) -> None:
        """Close the hardware (any state → UNCONFIGURED)."""
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
    """Hardware whose requests can be sent before ``read`` is called.

    All components send their requests first, so that they wait for the replies at the same time.
    """

    def request(self, deadline_s: float | None) -> None:
        """Send the requests whose replies the next ``read`` returns.

        Args:
            deadline_s: Time until which ``read`` waits, in seconds on the component's clock. If None, the component
                decides.
        """
        ...


@runtime_checkable
class WithOutputs(Protocol):
    """Hardware with outputs, which are command interfaces that do not move a joint, such as a servo's LED."""

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of these command interfaces, such as ``lamp/led``."""
        ...


def outputs_of(hardware: Hardware) -> tuple[str, ...]:
    """Return the outputs of a component."""
    return hardware.outputs if isinstance(hardware, WithOutputs) else ()


@runtime_checkable
class DoubtingLeaps(Protocol):
    """Hardware that checks by itself whether a joint can have reached the measured position.

    For all other hardware, ``LeapFilter`` performs this check with the joints' velocity limits.
    """

    doubts_leaps: bool


@runtime_checkable
class Reactivating(Protocol):
    """Active hardware that can re-enable the torque of single joints."""

    @property
    def without_torque(self) -> frozenset[str]:
        """Joints of the active hardware whose torque is no longer enabled.

        These joints receive no commands until they are activated again.
        """
        ...

    def reactivate(self) -> frozenset[str]:
        """Activate the limp joints while the other joints hold their positions.

        Returns:
            The names of the activated joints.

        Raises:
            ActivationError: A joint cannot be activated safely. The hardware stays active, and the joints stay limp.
            DriverError: The hardware does not respond. The state is the same as after an ActivationError.
        """
        ...


@runtime_checkable
class AskedForTorque(Protocol):
    """Hardware that must poll its joints, a few in each cycle, to detect disabled torque."""

    def ask_for_torque(self) -> frozenset[str]:
        """Poll all joints of the active hardware, and update ``without_torque``.

        This method is called between two cycles and may take as long as a late cycle.

        Returns:
            The names of the joints that did not respond.
        """
        ...


@runtime_checkable
class Holding(Protocol):
    """Hardware whose torque may be enabled while it is not active, for example after another program crashed."""

    def holds(self) -> bool:
        """Return whether torque is enabled for at least one joint of the configured hardware.

        Raises:
            DriverError: The hardware cannot be read.
        """
        ...

    def disable_torque(self) -> Sequence[str]:
        """Disable the torque of all joints of inactive or unconfigured hardware. The life cycle state does not change.

        Returns:
            Messages about errors, each with the name of the servo.

        Raises:
            DriverError: The hardware cannot be opened.
        """
        ...


@runtime_checkable
class Undoing(Protocol):
    """Hardware that remembers which joints were limp before its activation."""

    def undo_activation(self) -> Sequence[str]:
        """Disable the torque of the joints that were limp before the activation: ACTIVE → INACTIVE.

        Returns:
            Messages about errors.
        """
        ...


def undo_activation(hardware: Hardware) -> Sequence[str]:
    """Undo the activation of a component because a later step failed. Return the errors."""
    return hardware.undo_activation() if isinstance(hardware, Undoing) else hardware.deactivate(relax=True)
