"""Gripper of an arm."""

from collections.abc import Callable
from typing import Any

from servoloop.api.backend import ArmDescription
from servoloop.api.errors import ArmInputError
from servoloop.api.motion import ArmMotion


class ArmGripper:
    """Gripper with one joint. A gripper that closes on an object holds it and has arrived."""

    def __init__(self, arm: ArmDescription, move: Callable[..., ArmMotion]) -> None:
        self._arm, self._move = arm, move

    @property
    def joint(self) -> str:
        """Name of the joint. Raises ArmInputError if the arm has no gripper."""
        if not self._arm.hand:
            raise ArmInputError(f"{self._arm.name} has no gripper: move its joints with move_to")
        return self._arm.hand

    def open(self, **options: Any) -> ArmMotion:
        """Open the gripper. The options and the errors are those of ``Arm.move_to``."""
        return self.move(self._open_position, **options)

    def close(self, **options: Any) -> ArmMotion:
        """Close the gripper until it is closed or holds an object.

        The torque limit in the robot file bounds the force. The options and the errors are those of ``Arm.move_to``.
        """
        return self.move(self._closed_position, **options)

    def move(self, position: float, **options: Any) -> ArmMotion:
        """Move the gripper to a position in rad or m. The options and the errors are those of ``Arm.move_to``."""
        return self._move({self.joint: position}, **options)

    @property
    def _open_position(self) -> float:
        return self._arm.hand_open

    @property
    def _closed_position(self) -> float:
        return self._arm.hand_closed
