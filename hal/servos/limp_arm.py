"""An arm that a hand moves without torque: which of its servos hold torque, and how they are released."""

from collections.abc import Collection

from drivers.errors import DriverError
from hal.errors import ActivationError
from hal.joint import Joint
from hal.lifecycle import LifecycleState, require
from hal.servos.servo_hardware import ServoHardware
from hal.servos.servo_setup import ServoSetup


def servo_name(joint: Joint) -> str:
    """Name a joint and its servo, for messages."""
    return f"{joint.name} (servo {joint.address})"


def falls(servos: Collection[str]) -> str:
    """State which servos hold torque and what happens to the arm without it.

    Args:
        servos: Names of the servos, at least one, such as ``elbow_flex (servo 3)``.
    """
    holds, they_hold = ("holds", "it holds") if len(servos) == 1 else ("hold", "they hold")
    return f"{', '.join(servos)} {holds} torque, and what {they_hold} falls when torque goes off"


def release_question(servos: Collection[str]) -> str:
    """Ask whether these servos may be released."""
    return f"{falls(servos)}: hold the arm. Switch its torque off?"


class LimpArm(ServoHardware):
    """Servos that can be released while the arm is inactive. Nothing but ``let_go`` switches their torque off.

    Settings are not compared while a servo holds torque, because it takes none then: it may have to be released first.
    ``let_go`` and every activation compare them.
    """

    _unsettled = False
    """Whether settings have not been compared yet."""

    def _check(self, setup: ServoSetup) -> None:
        if problems := setup.strangers():
            raise DriverError("\n".join(problems))
        self._unsettled = bool(self.held())
        if not self._unsettled:
            setup.settle()

    def held(self) -> list[str]:
        """Name the servos that hold torque, or brake. Raises DriverError."""
        setup = ServoSetup(self._opened("look"))
        return [servo_name(joint) for joint in self._joints if setup.drives(joint)]

    def let_go(self) -> None:
        """Make the arm limp: it falls unless it is held by hand. Then its settings are compared.

        Raises ActivationError if a servo may still hold, DriverError for its settings.
        """
        require(self.state, LifecycleState.INACTIVE, "let go")
        setup = ServoSetup(self._opened("let go"))
        if problems := setup.torque_off(self._joints):
            raise ActivationError(f"the arm must be limp to be moved by hand: {'; '.join(problems)}")
        if self._unsettled:
            setup.settle()
        self._unsettled = False
