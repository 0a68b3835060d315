"""A limp arm that is moved by hand, and the code that releases its servos."""

from collections.abc import Collection

from drivers.driver_errors import DriverError
from hal.hal_errors import ActivationError
from hal.joint import Joint
from hal.lifecycle import LifecycleState, require
from hal.servos.servo_hardware import ServoHardware
from hal.servos.servo_setup import ServoSetup


def servo_name(joint: Joint) -> str:
    """Return the names of a joint and its servo for use in messages."""
    return f"{joint.name} (servo {joint.address})"


def torque_warning(servos: Collection[str]) -> str:
    """Return a warning that the torque of some servos is enabled and that the arm may fall when it is disabled.

    Args:
        servos: Names of at least one servo, such as ``elbow_flex (servo 3)``.
    """
    has = "has" if len(servos) == 1 else "have"
    return f"{', '.join(servos)} {has} torque enabled, and the arm may fall when torque is disabled"


def release_question(servos: Collection[str]) -> str:
    """Return the question that asks the user whether these servos may be released."""
    return f"{torque_warning(servos)}: hold the arm. Disable torque?"


class LimpArm(ServoHardware):
    """Arm whose servos can be released while it is inactive. Only ``release`` disables the servos' torque.

    A servo does not accept settings while its torque is enabled. The settings are therefore checked by ``release`` and
    at every activation.
    """

    _unsettled = False
    """Whether the settings must still be checked."""

    def _check(self, setup: ServoSetup) -> None:
        if problems := setup.identify_all():
            raise DriverError("\n".join(problems))
        self._unsettled = bool(self.held())
        if not self._unsettled:
            setup.settle()

    def held(self) -> list[str]:
        """Return the names of servos that drive or brake their motors. Raises DriverError."""
        setup = ServoSetup(self._opened("check the torque"))
        return [servo_name(joint) for joint in self._joints if setup.drives(joint)]

    def release(self) -> None:
        """Disable torque and check the settings. The arm falls unless it is supported by hand.

        Raises:
            ActivationError: The torque of a servo may still be enabled.
            DriverError: The settings of a servo are wrong.
        """
        require(self.state, LifecycleState.INACTIVE, "release")
        setup = ServoSetup(self._opened("release"))
        if problems := setup.torque_off(self._joints):
            raise ActivationError(f"the arm must be limp to be moved by hand: {'; '.join(problems)}")
        if self._unsettled:
            setup.settle()
        self._unsettled = False
