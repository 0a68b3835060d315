"""An arm that a hand moves without torque: which of its servos hold torque, and how they are released."""

from collections.abc import Collection

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
    """Servos that can be released while the arm is inactive. Nothing but ``let_go`` switches their torque off."""

    def held(self) -> list[str]:
        """Name the servos that hold torque, or brake. Raises DriverError."""
        setup = ServoSetup(self._opened("look"))
        return [servo_name(joint) for joint in self._joints if setup.drives(joint)]

    def let_go(self) -> None:
        """Make the arm limp: it falls unless it is held by hand. Raises ActivationError if a servo may still hold."""
        require(self.state, LifecycleState.INACTIVE, "let go")
        if problems := ServoSetup(self._opened("let go")).torque_off(self._joints):
            raise ActivationError(f"the arm must be limp to be moved by hand: {'; '.join(problems)}")
