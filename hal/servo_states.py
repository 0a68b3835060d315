"""The faults of servos, and how a servo that was missing rejoins: it has to show that it still drives its motor."""

import logging
from collections.abc import Container, Sequence
from typing import Final

from drivers.bus.types import ServoFault
from hal.joint import Joint
from hal.joint_buses import JointBuses
from hal.types import JointFault

LOG = logging.getLogger("servoloop.hal")

WITHHELD_AFTER: Final = 2
"""A servo that was missing for so many cycles gets no goals before it has been asked whether it drives its motor."""


class ServoFaults:
    """The faults of one component's servos, by joint name, until they have rejoined."""

    def __init__(self, joints: Sequence[Joint]) -> None:
        self.known: dict[str, JointFault] = {}
        """Almost always there are none, and then nothing here is called in a cycle."""
        self.withheld: set[str] = set()
        """Joints whose servos get no goals: one that was reset would take a goal for the order to switch its torque
        on, so it has to answer first."""
        self._joints = tuple(joints)
        self._missing: dict[str, int] = {}
        """For how many cycles a servo has not answered, until it has shown that it drives its motor."""

    def clear(self) -> None:
        """Forget all faults."""
        self.known.clear()
        self.withheld.clear()
        self._missing.clear()

    def note(self, name: str, fault: ServoFault) -> None:
        """A joint's servo has not answered in this cycle."""
        found = JointFault(fault.kind, fault.text)
        if name not in self.known and found not in self.known.values():  # a line's is told once
            LOG.error("%s", found.text)
        self.known[name] = found
        self._missing[name] = self._missing.get(name, 0) + 1
        if self._missing[name] >= WITHHELD_AFTER:
            self.withheld.add(name)

    def forget(self, answering: Container[str]) -> None:
        """Nobody needs the torque of an inactive component: a servo that answers again has no fault."""
        for name in [name for name in self.known if name in answering]:
            self._forget(name)

    def rejoin(self, answering: Container[str], buses: JointBuses, deadline_s: float) -> None:
        """Take back all that were missing and answer again; whoever there is no time to ask waits for the next cycle.

        A servo that lost its power comes back limp, and its goal is not ours any more.
        """
        back = {joint.name: joint for joint in self._joints if joint.name in self.known and joint.name in answering}
        if not back:
            return
        for name, driven in buses.torque_states(tuple(back.values()), deadline_s).items():
            called = f"{buses.label(back[name])}: servo {back[name].servo_id}"
            if driven:
                LOG.warning("%s answers again", called)
                self._forget(name)
            else:
                self._refuse_limp(name, called)

    def present(self, answering: Container[str]) -> dict[str, JointFault]:
        """A servo that answers again is no fault, whether it has been asked for its torque already or not."""
        return {name: fault for name, fault in self.known.items() if name not in answering or fault.kind == "no_torque"}

    def _forget(self, name: str) -> None:
        self.known.pop(name, None)
        self._missing.pop(name, None)
        self.withheld.discard(name)

    def _refuse_limp(self, name: str, called: str) -> None:
        fault = JointFault("no_torque", f"{called} came back without torque (power dip?): activate again")
        if self.known[name].kind != "no_torque":
            LOG.error("%s", fault.text)
        self.known[name] = fault
        self._missing[name] = WITHHELD_AFTER
        self.withheld.add(name)
