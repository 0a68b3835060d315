"""Torque limits that are reduced while a person moves the joints by hand."""

import logging
from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Final

from drivers.errors import ServoError
from hal.joint import Joint
from hal.servos.servo_setup import ServoSetup

LOG = logging.getLogger("servoloop.hal")
SOFT_SHARE: Final = 0.7
"""Share of each joint's torque limit while the arm is soft: at most half for the weight, the rest for holding. Even if
a servo does not answer and does not yield, the user can move the joint by hand.
"""


class SoftTorque:
    """Torque limits of the joints of one component, reduced and restored between two cycles."""

    def __init__(self, joints: Sequence[Joint]) -> None:
        """``joints`` have their full torque limits."""
        self._joints = tuple(joints)
        self.reduced: frozenset[str] = frozenset()
        """Joints whose torque limits may be reduced."""

    def reduce(self, setup: ServoSetup) -> list[str]:
        """Reduce the torque limits of all joints to ``SOFT_SHARE``. Return one sentence for each failure."""
        self.reduced = frozenset(joint.name for joint in self._joints)  # a servo that fails may have the new limit
        return _write(setup, [replace(one, torque_limit=SOFT_SHARE * one.torque_limit) for one in self._joints])[0]

    def restore(self, setup: ServoSetup, silent: Collection[str] = ()) -> None:
        """Restore the torque limits that are reduced. Joints whose servos fail are logged and stay in ``reduced``.

        Args:
            setup: Access to the servos.
            silent: Joints that do not answer now. They are left out and stay in ``reduced``.
        """
        problems, written = _write(setup, [j for j in self._joints if j.name in self.reduced and j.name not in silent])
        self.reduced -= written
        for problem in problems:
            LOG.error("a torque limit is still reduced: %s", problem)


def _write(setup: ServoSetup, joints: Sequence[Joint]) -> tuple[list[str], set[str]]:
    """Write the torque limits of joints, even if some servos fail. Return the failures and the joints written."""
    problems, written = list[str](), set[str]()
    for joint in joints:
        try:
            setup.limit_torque(joint)
            written.add(joint.name)
        except ServoError as error:  # the other joints also hold the arm
            problems.append(str(error))
    return problems, written
