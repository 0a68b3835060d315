"""An arm that a hand moves: limp and only read, or held by servos that pull with part of what they have."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Final

from drivers.bus.bus import Bus
from drivers.clock import Clock
from drivers.errors import DriverError, ServoError
from hal.compensation.gravity_compensation import GravityCompensation
from hal.joint import Joint
from hal.servos.limp_arm import LimpArm
from hal.servos.servo_setup import ServoSetup

SOFT_SHARE: Final = 0.7
"""Of each joint's torque limit, while it is soft: half for the weight, at the most, and a little to hold with. So a
hand can overcome a servo that does not answer, and does not give way."""


class HandGuidedArm(LimpArm):
    """All joints of an arm. A soft one has less than the joints' own torque limits, until they are restored."""

    def __init__(
        self,
        name: str,
        joints: Sequence[Joint],
        open_buses: Callable[[], Bus | Mapping[str, Bus]],
        clock: Clock,
        compensation: GravityCompensation | None = None,
        soft: bool = False,
    ) -> None:
        """``compensation`` is that of the joints with their own limits."""
        share = SOFT_SHARE if soft else 1.0
        held = [replace(joint, torque_limit=share * joint.torque_limit) for joint in joints]
        super().__init__(name, held, open_buses, clock, compensation)
        self._own = tuple(joints)

    def restore_torque_limits(self) -> None:
        """Give all joints their own torque limits, between two cycles. Raises DriverError with all that have not."""
        setup, problems = ServoSetup(self._opened("stiffen")), []
        for joint in self._own:
            try:
                setup.limit_torque(joint)
            except ServoError as error:  # the others hold the arm too
                problems.append(str(error))
        if problems:
            raise DriverError(f"still soft: {'; '.join(problems)}")
