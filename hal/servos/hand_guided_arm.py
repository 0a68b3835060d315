"""An arm that is moved by hand. Its servos are limp, or hold the arm with reduced torque."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Final

from drivers.bus.bus import Bus
from drivers.clock import Clock
from drivers.errors import DriverError, ServoError
from hal.joint import Joint
from hal.servos.gravity_compensation import GravityCompensation
from hal.servos.limp_arm import LimpArm
from hal.servos.servo_setup import ServoSetup

SOFT_SHARE: Final = 0.7
"""Share of each joint's torque limit while the arm is soft: at most half for the weight, the rest for holding. Even if
a servo does not answer and does not yield, the user can move the joint by hand.
"""


class HandGuidedArm(LimpArm):
    """An arm that is moved by hand. In a soft arm, the torque limits are reduced until they are restored."""

    def __init__(
        self,
        name: str,
        joints: Sequence[Joint],
        open_buses: Callable[[], Bus | Mapping[str, Bus]],
        clock: Clock,
        compensation: GravityCompensation | None = None,
        soft: bool = False,
    ) -> None:
        """Create the arm.

        Args:
            name: Name of the component.
            joints: Joints with their full torque limits.
            open_buses: Function that opens the bus, or the buses by name.
            clock: Clock of the control loop.
            compensation: Gravity compensation for the joints with their full torque limits.
            soft: Whether the torque limits are reduced.
        """
        share = SOFT_SHARE if soft else 1.0
        held = [replace(joint, torque_limit=share * joint.torque_limit) for joint in joints]
        super().__init__(name, held, open_buses, clock, compensation)
        self._own = tuple(joints)

    def restore_torque_limits(self) -> None:
        """Restore the torque limits of all joints, between two cycles.

        Raises:
            DriverError: Torque limits could not be restored. The message names all joints concerned.
        """
        setup, problems = ServoSetup(self._opened("stiffen")), []
        for joint in self._own:
            try:
                setup.limit_torque(joint)
            except ServoError as error:  # the other joints also hold the arm
                problems.append(str(error))
        if problems:
            raise DriverError(f"the torque limits are still reduced: {'; '.join(problems)}")
