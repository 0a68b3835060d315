"""The faults of a component's servos: who is missing, who has lost the torque, and how each rejoins."""

import logging
import math
from collections.abc import Mapping, Sequence
from typing import Final

from drivers.bus.types import ServoFault
from drivers.clock import Clock
from hal.joint import Joint
from hal.servos.joint_buses import JointBuses
from hal.types import JointFault

LOG = logging.getLogger("servoloop.hal")

RESET_S: Final = 0.1
"""A servo that was not heard for so long gets no goals before it has been asked whether it drives its motor. By
Feetech's manual a restart takes 0.8 s; one that should be quicker is found by its torque limit."""
WATCH_S: Final = 0.35
"""Within this time every servo is asked whether it still drives its motor: there are ways to lose that in silence."""
TAKEN: Final = ("current", "temperature")
"""Alarms with which a servo lets go. A goal would switch it on again, or send it off once it has cooled down."""


class ServoFaults:
    """A silent servo is named until it has rejoined.

    An active component's servo has to show first that it still drives its motor: to most servos a goal is the order
    to switch the torque on. One that was let go must be activated again.
    """

    def __init__(self, joints: Sequence[Joint], clock: Clock) -> None:
        self.withheld: set[str] = set()
        """Joints whose servos must get no goals."""
        self._joints = tuple(joints)
        self._clock = clock
        self._faults: dict[str, JointFault] = {}
        self._let_go: dict[str, str] = {}
        """Joints whose servos have let go to protect themselves, and what to say of it."""
        self._heard_s: dict[str, float] = {}
        """When those that are missing were last measured."""
        self._next = 0
        self._next_s = 0.0

    def forget(self) -> None:
        """Forget all faults: the servos start anew."""
        self._faults.clear()
        self._let_go.clear()
        self._heard_s.clear()
        self.withheld.clear()

    def note_missing(self, name: str, fault: ServoFault, heard_s: float) -> None:
        """A joint's servo, last measured at ``heard_s``, has given no state."""
        found = JointFault(fault.kind, fault.text)
        if name not in self._faults and found not in self._faults.values():  # a line's is told once
            LOG.error("%s", found.text)
        self._faults[name] = found
        if self._clock.now() - self._heard_s.setdefault(name, heard_s) >= RESET_S:
            self.withheld.add(name)

    def note_alarms(self, joint: Joint, alarms: Sequence[str], buses: JointBuses) -> None:
        """An active component's servo has alarms; with some of them it has let go."""
        taken = [alarm for alarm in alarms if alarm in TAKEN]
        if taken and joint.name not in self._let_go:
            self._let_go[joint.name] = f"{_called(joint, buses)} has let go ({', '.join(taken)} alarm)"
            self._refuse(joint.name, self._let_go[joint.name])

    def present(
        self, measured: Mapping[str, int], buses: JointBuses, ask_until_s: float | None
    ) -> dict[str, JointFault]:
        """The faults after a cycle in which these joints (by name) were measured.

        ``ask_until_s``: until then servos that are to drive their motors are asked for that: those whose turn it is,
        and all that answer again. Whoever there is no time to ask waits for the next cycle.
        """
        back = [joint for joint in self._joints if joint.name in self._faults and joint.name in measured]
        if ask_until_s is None:
            for joint in back:
                self._rejoin(joint.name)
        else:
            for name in [joint.name for joint in back if joint.name in self._let_go]:
                self._refuse(name, self._let_go[name])  # also if it was silent meanwhile
            self._ask([joint for joint in back if joint.name not in self._let_go], buses, ask_until_s)
            due = [joint for joint in self._due() if joint.name in measured and joint.name not in self._faults]
            self._watch(due, buses, ask_until_s)
        return {
            name: fault for name, fault in self._faults.items() if name not in measured or fault.kind == "no_torque"
        }

    def _ask(self, back: Sequence[Joint], buses: JointBuses, ask_until_s: float) -> None:
        """Take back all that were missing and have their torque. One that lost its power comes back limp."""
        called = {joint.name: _called(joint, buses) for joint in back}
        for name, driven in (buses.torque_states(back, ask_until_s) if back else {}).items():
            if driven:
                LOG.warning("%s answers again", called[name])
                self._rejoin(name)
            else:
                self._refuse(name, f"{called[name]} came back without torque (power dip?)")

    def _watch(self, due: Sequence[Joint], buses: JointBuses, ask_until_s: float) -> None:
        driven = buses.torque_states(due, ask_until_s) if due else {}
        limp = [joint for joint in due if driven.get(joint.name) is False]
        # The answer to another program's question may have been taken for ours: whoever says no is asked twice.
        again = buses.torque_states(limp, ask_until_s) if limp else {}
        for joint in limp:
            if not again.get(joint.name):
                self._refuse(
                    joint.name, f"{_called(joint, buses)} has lost its torque (current protection, power dip?)"
                )

    def _due(self) -> list[Joint]:
        """The joints whose turn it is to show that their servos have torque."""
        due: list[Joint] = []
        now_s, each_s = self._clock.now(), WATCH_S / len(self._joints)
        self._next_s = max(self._next_s, now_s - WATCH_S)
        while self._next_s <= now_s:
            due.append(self._joints[self._next])
            self._next = (self._next + 1) % len(self._joints)
            self._next_s += each_s
        return due

    def _rejoin(self, name: str) -> None:
        del self._faults[name]
        self._heard_s.pop(name, None)
        self.withheld.discard(name)

    def _refuse(self, name: str, what: str) -> None:
        former = self._faults.get(name)
        if former is None or former.kind != "no_torque":
            LOG.error("%s: activate again", what)
            self._faults[name] = JointFault("no_torque", f"{what}: activate again")
        self._heard_s[name] = -math.inf
        self.withheld.add(name)


def _called(joint: Joint, buses: JointBuses) -> str:
    return f"{buses.label(joint)}: servo {joint.servo_id}"
