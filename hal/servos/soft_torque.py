"""Torque limits that are reduced while a person moves the joints by hand."""

import logging
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import Final, Protocol, runtime_checkable

from drivers.driver_errors import ServoError
from hal.joint import Joint
from hal.servos.gravity_compensation import GravityCompensation
from hal.servos.servo_setup import ServoSetup

LOG = logging.getLogger("servoloop.hal")
SOFT_SHARE: Final = 0.7
"""Fraction of each joint's torque limit that remains available while the arm is soft. Supporting the arm's weight takes
at most half of the full limit. The rest of the reduced limit holds the joint's position. Even if a servo does not
respond and does not yield, the user can still move the joint by hand.
"""


class SoftTorque:
    """Torque limits of the joints of one active component, reduced and restored between two cycles."""

    def __init__(
        self, joints: Sequence[Joint], setup: Callable[[], ServoSetup], compensation: GravityCompensation | None
    ) -> None:
        """Create the torque limits.

        Args:
            joints: Joints with their full torque limits.
            setup: Function that returns an object for accessing the servos.
            compensation: Gravity compensation, which does not work against the user's hand while the limits are
                reduced.
        """
        self._joints, self._setup, self._compensation = tuple(joints), setup, compensation
        self.reduced: frozenset[str] = frozenset()
        """Joints whose torque limits may be reduced."""

    def reduce(self) -> list[str]:
        """Reduce the torque limits of all joints to ``SOFT_SHARE``. Return one sentence for each failure.

        Raises DriverError if the port is lost.
        """
        self._guide(True)
        self.reduced = frozenset(joint.name for joint in self._joints)  # a servo that fails may have the new limit
        return self._write([replace(one, torque_limit=SOFT_SHARE * one.torque_limit) for one in self._joints])[0]

    def restore(self, silent: Collection[str] = ()) -> None:
        """Restore the torque limits that have been reduced. Joints whose servos fail are logged and remain in
        ``reduced``.

        Args:
            silent: Joints whose servos currently do not respond. These joints are skipped and remain in ``reduced``.

        Raises:
            DriverError: The port is lost.
        """
        self._guide(False)
        problems, written = self._write([j for j in self._joints if j.name in self.reduced and j.name not in silent])
        self.reduced -= written
        for problem in problems:
            LOG.error("a torque limit is still reduced: %s", problem)

    def _guide(self, guided: bool) -> None:
        if self._compensation is not None:
            self._compensation.guided = guided

    def _write(self, joints: Sequence[Joint]) -> tuple[list[str], set[str]]:
        """Write the torque limits of joints, even if some servos fail. Return the failures and the joints written."""
        problems, written = list[str](), set[str]()
        for joint in joints:
            try:
                self._setup().limit_torque(joint)
                written.add(joint.name)
            except ServoError as error:  # the other joints also support the arm
                problems.append(str(error))
        return problems, written


@runtime_checkable
class Softening(Protocol):
    """Hardware whose torque limits can be reduced while a person moves its joints by hand."""

    soft_torque: SoftTorque
