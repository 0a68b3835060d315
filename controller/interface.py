"""Define the controller interface: how the manager uses a controller, and the context in which a controller is
built.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, cast

from controller.parameters import Parameters
from hal.compensation.servo_compliance import Compliance, lags
from hal.robot_description.description import Description, HardwareInfo
from hal.types import FloatArray, JointLimits, JointState

Settled = Callable[[str], bool]
"""Function that returns whether the controller of that name has brought its joints to their command."""


@dataclass(frozen=True, slots=True)
class ControllerContext:
    """Robot and other controllers, as known to a controller when it is built."""

    description: Description
    """The URDF."""
    component: HardwareInfo
    """All ``<ros2_control>`` blocks as one."""
    limits: Mapping[str, JointLimits]
    """Limits by joint name."""
    settled: Settled
    """Returns whether another controller has brought its joints to their command."""
    compliances: Mapping[str, Compliance] = field(default_factory=dict)
    """How far the servos yield and lag, by joint name. A joint that is missing follows its command at once."""

    def lags(self, joints: Sequence[str]) -> FloatArray:
        """Return the lags of joints, for the trajectory sampler.

        Args:
            joints: Names of the joints.

        Returns:
            Array of shape (3, n), with a column per joint. Its rows are the lag (s), the acceleration of the
            servo's profile (rad/s² or m/s²), and the factor of the acceleration (s²).
        """
        return lags([self.compliances.get(joint) for joint in joints])


class ControllerType(Protocol):
    """Plug-in: the class of a controller."""

    kind: str
    """The ``type`` in the controllers file."""
    parameters_type: type[Parameters]
    """Class of the parameters."""

    def build(self, name: str, parameters: Any, context: ControllerContext) -> "Controller":
        """Build a controller. This is a class method.

        Args:
            name: Name of the controller in the controllers file.
            parameters: Validated parameters, of the type ``parameters_type``.
            context: The robot and its other controllers.

        Returns:
            The controller, not yet active.

        Raises:
            ValueError: The parameters do not fit the robot. The message explains the correction.
        """
        ...


class Controller(Protocol):
    """Controller, called by the thread of the loop once per cycle. It must not do I/O or wait.

    While it is active, a controller claims its ``command_interfaces``.
    """

    @property
    def name(self) -> str:
        """Name in the controllers file."""
        ...

    @property
    def parameters(self) -> Parameters:
        """Current parameters."""
        ...

    @property
    def kind(self) -> str:
        """Type of the plug-in, as in the controllers file."""
        ...

    @property
    def command_interfaces(self) -> tuple[str, ...]:
        """Names of the interfaces that the controller commands, such as ``joint1/position``."""
        ...

    @property
    def state_interfaces(self) -> tuple[str, ...]:
        """Names of the interfaces that the controller reads."""
        ...

    @property
    def command(self) -> FloatArray:
        """Values of the ``command_interfaces`` at the end of the coming period, of shape (n,), in rad or m."""
        ...

    def activate(self, state: JointState, command: FloatArray) -> None:
        """Start to command the joints, without a jump.

        Args:
            state: Measurement of this cycle.
            command: Last command of the hardware, of shape (n,).
        """
        ...

    def deactivate(self, reason: str = "") -> None:
        """End the running goal, with a result for its client.

        Args:
            reason: Reason of the deactivation; empty if a client requested it.
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
        """Return whether the joints have arrived at their command or can move no further.

        Returns:
            Whether other controllers need not wait for this one.
        """
        ...


class Relieving(Controller, Protocol):
    """Controller that relieves its joints after its deactivation, until they no longer press against an obstacle."""

    def begin_relief(self, state: JointState, command: FloatArray) -> None:
        """Begin the relief. The joints are at rest, and no other controller commands them.

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
    """Return the controller if it relieves its joints, otherwise None. It may be wrapped in another object."""
    return cast(Relieving, controller) if hasattr(controller, "begin_relief") else None


def indices(joints: Sequence[str], among: Sequence[str]) -> list[int]:
    """Return the index of each joint in the hardware's order."""
    return [among.index(name) for name in joints]


def limits_of(joints: Sequence[str], limits: Mapping[str, JointLimits]) -> tuple[JointLimits, ...]:
    """Return the limits in the order of ``joints``."""
    return tuple(limits[name] for name in joints)
