"""Hardware component for a leader arm, which is moved by hand. The servos are limp and are only read."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from drivers.clock import Clock
from hal.hal_errors import ActivationError
from hal.joint import Joint
from hal.servos.limp_arm import LimpArm, torque_warning
from hal.servos.open_buses import OpenBuses
from hal.servos.servo_setup import ServoSetup
from hal.types import JointState

LEADER: Final = "leader"


def leader_joint(joint: str) -> str:
    """Return the name of a leader's joint, which differs from the joint names of the follower."""
    return f"{LEADER}/{joint}"


class LeaderArm(LimpArm):
    """Leader arm.

    The component does not accept commands and stays inactive, so its torque cannot be enabled. Its joints are named
    ``leader/NAME``, because the follower may have joints with the same names.
    """

    def __init__(self, joints: Sequence[Joint], open_buses: OpenBuses, clock: Clock) -> None:
        super().__init__(LEADER, [replace(one, name=leader_joint(one.name)) for one in joints], open_buses, clock)
        self.command_interfaces = ()
        self.asked_s = self.measured_s = 0.0
        """Clock times of the last request and of the request that returned the last measurement."""
        self._released = False

    def _check(self, setup: ServoSetup) -> None:
        """Check the servos when the component is configured, without enabling or disabling their torque.

        Raises:
            ActivationError: A leader that was released before has its torque enabled when it is reconnected. It may be
                a different arm.
            DriverError: A servo does not respond, or does not match the robot file.
        """
        super()._check(setup)
        if self._released and (servos := self.held()):
            raise ActivationError(
                f"the leader was limp before its connection was lost. Now {torque_warning(servos)}: "
                "restart teleoperation"
            )

    def release(self) -> None:
        super().release()
        self._released = True

    def activate(self) -> None:
        """Raise ActivationError, because a leader is never driven."""
        raise ActivationError("a leader arm is moved by hand, so its torque is never enabled")

    def request(self, deadline_s: float | None = None) -> None:
        self.asked_s = self._clock.now()
        super().request(deadline_s)

    def read(self) -> JointState:
        state = super().read()
        self.measured_s = self.asked_s  # the measurement is not older than its request
        return state
