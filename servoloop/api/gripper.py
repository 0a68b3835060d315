"""Gripper of an arm."""

import math
from collections.abc import Callable

from servoloop.api.arm_errors import ArmInputError
from servoloop.api.backend import ArmDescription
from servoloop.api.motion import ArmMotion


class ArmGripper:
    """Gripper with one joint. If the gripper closes on an object, it holds the object, and the motion is reported as
    complete."""

    def __init__(self, arm: ArmDescription, move: Callable[..., ArmMotion]) -> None:
        self._arm, self._move = arm, move

    @property
    def joint(self) -> str:
        """Name of the joint. Raises ArmInputError if the arm has no gripper."""
        if not self._arm.hand:
            raise ArmInputError(f"{self._arm.name} has no gripper: move its joints with move_to")
        return self._arm.hand

    def open(
        self,
        *,
        duration: float | None = None,
        speed: float | None = None,
        wait: bool = True,
        timeout: float = math.inf,
    ) -> ArmMotion:
        """Open the gripper. The options, the result and the errors are the same as for ``Arm.move_to``."""
        return self.move(self._arm.hand_open, duration=duration, speed=speed, wait=wait, timeout=timeout)

    def close(
        self,
        *,
        duration: float | None = None,
        speed: float | None = None,
        wait: bool = True,
        timeout: float = math.inf,
    ) -> ArmMotion:
        """Close the gripper until it is fully closed or holds an object.

        The gripping force is limited by the torque limit in the robot file. The options, the result and the errors are
        the same as for ``Arm.move_to``.
        """
        return self.move(self._arm.hand_closed, duration=duration, speed=speed, wait=wait, timeout=timeout)

    def move(
        self,
        position: float,
        *,
        duration: float | None = None,
        speed: float | None = None,
        wait: bool = True,
        timeout: float = math.inf,
    ) -> ArmMotion:
        """Move the gripper.

        Args:
            position: Target in rad or m.
            duration: Duration of the motion, in seconds. The joint limits may make the motion take longer.
            speed: Fraction of the velocity limit to use instead of a duration, above 0 and at most 1. Default: 0.25.
            wait: Whether to wait for the end of the motion.
            timeout: Maximum time to wait, in seconds.

        Returns:
            Handle of the motion.

        Raises:
            ArmInputError: The arm has no gripper, or the position is not finite or outside the limits.
            ArmError: The same errors as for ``Arm.move_to``.
        """
        return self._move({self.joint: position}, duration=duration, speed=speed, wait=wait, timeout=timeout)
