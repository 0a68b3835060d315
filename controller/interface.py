"""Define the interface between the controller manager and a controller."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, cast

from controller.parameters import Parameters
from hal.compensation.servo_compliance import Compliance, lags
from hal.outputs import Outputs
from hal.robot_description.description import Description, HardwareInfo
from hal.types import FloatArray, JointLimits, JointState

Settled = Callable[[str], bool]
"""Function that returns whether the joints of the named controller have reached their commanded positions."""


@dataclass(frozen=True, slots=True)
class ControllerContext:
    """Information about the robot and its other controllers that is passed to each new controller."""

    description: Description
    """The robot description."""
    component: HardwareInfo
    """All ``<ros2_control>`` blocks, merged into one."""
    limits: Mapping[str, JointLimits]
    """Limits of each joint, keyed by joint name."""
    settled: Settled
    """Function that returns whether the joints of another controller have reached their commanded positions."""
    compliances: Mapping[str, Compliance] = field(default_factory=dict)
    """Compliance and lag of servos, keyed by joint name. A joint without an entry follows its command immediately."""
    outputs: Outputs = field(default_factory=Outputs)
    """Outputs of the hardware, which do not move any joints."""

    def lags(self, joints: Sequence[str]) -> FloatArray:
        """Return the lags of the given joints, for use by the trajectory sampler.

        Args:
            joints: Names of the joints.

        Returns:
            Array of shape (3, n), with one column per joint. Its rows contain the lag (s), the acceleration of the
            servo's profile (rad/s² or m/s²), and the acceleration factor (s²).
        """
        return lags([self.compliances.get(joint) for joint in joints])


class ControllerType(Protocol):
    """A controller plugin, which is the class of a controller."""

    kind: str
    """The controller's ``type`` in the controllers file."""
    parameters_type: type[Parameters]
    """Class that validates the controller's parameters."""

    def build(self, name: str, parameters: Any, context: ControllerContext) -> "Controller":
        """Build a controller. This is a class method.

        Args:
            name: Name of the controller in the controllers file.
            parameters: Validated parameters, of the type ``parameters_type``.
            context: The robot and its other controllers.

        Returns:
            The new controller, which is not active yet.

        Raises:
            ValueError: The parameters are not suitable for the robot. The message tells the user what to correct.
        """
        ...


class Controller(Protocol):
    """A controller.

    The loop thread updates the controller once per cycle, so the controller must neither block nor do I/O.

    While it is active, a controller claims its n ``command_interfaces``.
    """

    @property
    def name(self) -> str:
        """Name of the controller."""
        ...

    @property
    def parameters(self) -> Parameters:
        """Parameters with which the controller was built."""
        ...

    @property
    def kind(self) -> str:
        """The ``type`` of the controller in the controllers file."""
        ...

    @property
    def command_interfaces(self) -> tuple[str, ...]:
        """Command interfaces of the controller, such as ``joint1/position``."""
        ...

    @property
    def state_interfaces(self) -> tuple[str, ...]:
        """State interfaces that the controller reads."""
        ...

    @property
    def command(self) -> FloatArray:
        """Command for the end of the next period, in the order of ``command_interfaces``: shape (n,), rad or m."""
        ...

    def activate(self, state: JointState, command: FloatArray) -> None:
        """Start commanding the joints without a jump.

        Args:
            state: Measurement of this cycle.
            command: Last command sent to the hardware, of shape (n,).
        """
        ...

    def deactivate(self, reason: str = "") -> None:
        """Abort the current goal, and report the result to its client.

        Args:
            reason: Reason for the deactivation; empty if a client requested it.
        """
        ...

    def update(self, state: JointState, now_s: float, period_s: float) -> None:
        """Run one cycle, which sets ``command``.

        Args:
            state: Measurement of this cycle.
            now_s: Time of the measurement, in seconds.
            period_s: Duration of the period, in seconds.
        """
        ...

    def settled(self) -> bool:
        """Return whether the joints have reached their commanded positions or cannot move further.

        Returns:
            True if other controllers need not wait for this controller.
        """
        ...


class Relieving(Controller, Protocol):
    """A controller that can relieve its joints after deactivation, so that they do not press against an obstacle."""

    def begin_relief(self, state: JointState, command: FloatArray) -> None:
        """Begin the relief. The joints are at rest, and no other controller commands them. The controller may not have
        been active before.

        Args:
            state: Measurement of this cycle.
            command: Command of the joints, of shape (n,).
        """
        ...

    def relieve(self, state: JointState, now_s: float, period_s: float) -> bool:
        """Run one cycle of the relief, which sets ``command``.

        Args:
            state: Measurement of this cycle.
            now_s: Time of the measurement, in seconds.
            period_s: Duration of the period, in seconds.

        Returns:
            Whether another cycle is needed.
        """
        ...


def relieving(controller: Controller) -> Relieving | None:
    """Return the controller if it can relieve its joints; otherwise, return None. The controller may be wrapped in
    another object."""
    return cast(Relieving, controller) if hasattr(controller, "begin_relief") else None


def indices(joints: Sequence[str], among: Sequence[str]) -> list[int]:
    """Return the index of each joint in the sequence ``among``."""
    return [among.index(name) for name in joints]


def limits_of(joints: Sequence[str], limits: Mapping[str, JointLimits]) -> tuple[JointLimits, ...]:
    """Return the limits of the given joints, in the order of ``joints``."""
    return tuple(limits[name] for name in joints)
