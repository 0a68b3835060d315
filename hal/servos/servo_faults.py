"""The faults of a component's servos: who is missing, who has lost the torque, and how each rejoins."""

import logging
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from drivers.bus.types import ServoFault
from drivers.clock import Clock
from drivers.servos.catalog import series_of
from hal.joint import Joint
from hal.servos.fault_log import FaultLog
from hal.servos.joint_buses import JointBuses
from hal.types import JointFault

LOG = logging.getLogger("servoloop.hal")

RESET_S: Final = 0.1
"""A servo that was not heard for so long gets no goals before it has been asked whether it drives its motor. By
Feetech's manual a restart takes 0.8 s; one that should be quicker is found by its torque limit."""
WATCH_S: Final = 0.35
"""Within this time every servo is asked whether it still drives its motor: there are ways to lose that in silence."""
MISSED: Final = 1.2
"""So many times that without an answer: a servo has missed its turn, and is asked in every cycle that has the time."""
LATEST: Final = 1.4
"""So many times that: no cycle had the time, and the servo is asked beyond the end of one. Better one late cycle now
and then than a limp joint that nobody knows of, or one that gets no goals for ever."""
QUICK_S: Final = 0.008
"""A line that answers within this time is asked for one servo in such a cycle, which need not miss the next one then. A
slower one is asked for all at once: their answers are held back together."""
LATE_S: Final = 0.08
"""How late that cycle may be: the question twice, through an adapter that holds answers back. Less than ``RESET_S``."""
TAKEN: Final = ("current", "temperature")
"""Alarms with which a servo lets go. A goal would switch it on again, or send it off once it has cooled down."""
REBOOT: Final = "reboot it (servoloop reboot), then activate again; the port is free once this program has ended"
"""What to do where a servo has shut down and refuses its torque until then."""
_UNASKED: Final = "answers again, and nobody has asked it yet whether it has torque: it gets no goals until then"


class ServoFaults:
    """A silent servo is named until it has rejoined.

    An active component's servo has to show first that it still drives its motor: to most servos a goal is the order
    to switch the torque on. One that was let go must be activated again.
    """

    def __init__(self, joints: Sequence[Joint], clock: Clock) -> None:
        self.withheld: set[str] = set()
        """Joints whose servos must get no goals."""
        self.log = FaultLog()
        """The log of a cycle's events."""
        self._joints = tuple(joints)
        self._clock = clock
        self._faults: dict[str, JointFault] = {}
        self._let_go: dict[str, str] = {}
        """Joints whose servos have let go to protect themselves, and what to say of it."""
        self._latched: dict[str, str] = {}
        """Alarms that last until a reboot."""
        self._heard_s: dict[str, float] = {}
        """When those that are missing were last measured."""
        self._shown_s: dict[str, float] = {}
        """When each was last found to drive its motor, or else missing."""
        self._next = 0
        self._next_s = self._next_late_s = 0.0
        self._quick = True
        """Whether the line was when a cycle was late for it."""

    def forget(self) -> None:
        """Forget all faults: the servos start anew."""
        self._faults.clear()
        self._let_go.clear()
        self._latched.clear()
        self._heard_s.clear()
        self.withheld.clear()

    @property
    def named(self) -> frozenset[str]:
        """Joints that have a fault, or get no goals."""
        return frozenset(self._faults) | self.withheld

    def reactivated(self, names: Iterable[str]) -> None:
        """The servos of these joints have been checked and have their torque again."""
        known = set(names)
        names = [joint.name for joint in self._joints if joint.name in known]
        for name in names:
            for facts in (self._faults, self._let_go, self._latched, self._heard_s):
                facts.pop(name, None)
            self.withheld.discard(name)
            self._shown_s[name] = self._clock.now()
        if names:
            one = len(names) == 1
            ends = (
                "is activated again: it holds where it is" if one else "are activated again: they hold where they are"
            )
            LOG.warning("%s %s", ", ".join(names), ends)

    def ask_all(self, buses: JointBuses) -> frozenset[str]:
        """Ask every servo now that is not named; one without torque is named then.

        Returns the joints whose servos gave no answer.
        """
        begin_s = self._clock.now()
        try:
            self._watch([joint for joint in self._joints if joint.name not in self.named], buses, begin_s + LATE_S)
        finally:
            self.log.flush()
        named, shown = self.named, self._shown_s
        return frozenset(n for n in (j.name for j in self._joints) if n not in named and shown.get(n, 0.0) < begin_s)

    def note_missing(self, joint: Joint, fault: ServoFault | JointFault, heard_s: float, buses: JointBuses) -> None:
        """A joint's servo, last measured at ``heard_s``, has given no state, or none that is believed."""
        name = joint.name
        found = JointFault(fault.kind, fault.text)
        if found.kind == "implausible" and name in self._faults and self._faults[name].kind == "no_torque":
            return  # a limp joint may well be moved, and must go on being named as limp
        if name not in self._faults and found not in self._faults.values():  # a line's is told once
            self.log.note(logging.ERROR, buses.label(joint), joint.servo_id, found.text)
        self._faults[name] = found
        self._shown_s[name] = self._clock.now()
        if self._clock.now() - self._heard_s.setdefault(name, heard_s) >= RESET_S:
            self.withheld.add(name)

    def note_alarms(self, joint: Joint, alarms: Sequence[str], buses: JointBuses) -> None:
        """An active component's servo has alarms; with some of them it has let go."""
        if series_of(joint.model).hardware_error:
            self._latched[joint.name] = f"{', '.join(alarms)} alarm"
        taken = [alarm for alarm in alarms if alarm in TAKEN]
        if taken and joint.name not in self._let_go:
            self._let_go[joint.name] = f"{_called(joint, buses)} has let go ({', '.join(taken)} alarm)"
            self._refuse(joint, buses, self._let_go[joint.name])

    def present(
        self, measured: Mapping[str, int], buses: JointBuses, ask_until_s: float | None
    ) -> dict[str, JointFault]:
        """The faults after a cycle in which these joints (by name) were measured.

        ``ask_until_s``: until then servos that are to drive their motors are asked for that: those whose turn it is,
        and all that answer again. Whoever there is no time to ask waits for the next cycle, but not for ever.
        """
        back = [joint for joint in self._joints if joint.name in self._faults and joint.name in measured]
        for joint in back:
            if joint.name not in self.withheld:  # the next silence is another one
                self._heard_s.pop(joint.name, None)
        if ask_until_s is None:
            for joint in back:
                self._rejoin(joint.name)
            self._shown_s = dict.fromkeys((joint.name for joint in self._joints), self._clock.now())
        else:
            for joint in [joint for joint in back if joint.name in self._let_go]:
                self._refuse(joint, buses, self._let_go[joint.name])  # also if it was silent meanwhile
            begin_s, late = self._clock.now(), self._overdue(measured)
            until_s = begin_s + LATE_S if late else ask_until_s
            self._ask([joint for joint in back if joint.name not in self._let_go], buses, until_s)
            due = self._due(measured, 0.0 if late else MISSED * WATCH_S)
            due = [joint for joint in due if joint.name not in self._faults]
            self._watch(due[:1] if late and self._quick else due, buses, until_s)
            if late:
                was_quick, self._quick = self._quick, self._clock.now() - begin_s < QUICK_S
                self._next_late_s = begin_s + (0.0 if was_quick else LATEST * WATCH_S)
        unasked = {
            joint.name: JointFault("no_torque", f"{_called(joint, buses)} {_UNASKED}")
            for joint in back
            if joint.name in self.withheld and self._faults[joint.name].kind != "no_torque"
        }
        return {n: f for n, f in self._faults.items() if n not in measured or f.kind == "no_torque"} | unasked

    def _overdue(self, measured: Mapping[str, int]) -> bool:
        """Whether this cycle is to be the late one."""
        return self._clock.now() >= self._next_late_s and bool(self._unseen(LATEST * WATCH_S, measured))

    def _driven(self, joints: Sequence[Joint], buses: JointBuses, ask_until_s: float) -> dict[str, bool]:
        found = buses.torque_states(joints, ask_until_s) if joints else {}
        self._shown_s |= dict.fromkeys(found, self._clock.now())
        return found

    def _ask(self, back: Sequence[Joint], buses: JointBuses, ask_until_s: float) -> None:
        """Take back all that were missing and have their torque. One that lost its power comes back limp."""
        joints = {joint.name: joint for joint in back}
        for name, driven in self._driven(back, buses, ask_until_s).items():
            joint, called = joints[name], _called(joints[name], buses)
            if driven:
                self.log.note(logging.WARNING, buses.label(joint), joint.servo_id, f"{called} answers again")
                self._rejoin(name)
            else:
                why = self._latched.get(name, "power dip?")
                self._refuse(joint, buses, f"{called} came back without torque ({why})")

    def _watch(self, due: Sequence[Joint], buses: JointBuses, ask_until_s: float) -> None:
        driven = self._driven(due, buses, ask_until_s)
        limp = [joint for joint in due if driven.get(joint.name) is False]
        # The answer to another program's question may have been taken for ours: whoever says no is asked twice.
        again = self._driven(limp, buses, ask_until_s)
        for joint in limp:
            if not again.get(joint.name):
                why = self._latched.get(joint.name, "current protection, power dip?")
                self._refuse(joint, buses, f"{_called(joint, buses)} has lost its torque ({why})")

    def _due(self, measured: Mapping[str, int], missed_s: float) -> list[Joint]:
        """The joints whose servos are to show that they have torque: those that missed their turn, and whose it is."""
        due = self._unseen(missed_s, measured)
        now_s, each_s = self._clock.now(), WATCH_S / len(self._joints)
        self._next_s = max(self._next_s, now_s - WATCH_S)
        while self._next_s <= now_s:
            joint = self._joints[self._next]
            due += [joint] if joint.name in measured and joint not in due else []
            self._next = (self._next + 1) % len(self._joints)
            self._next_s += each_s
        return due

    def _unseen(self, for_s: float, measured: Mapping[str, int]) -> list[Joint]:
        """The joints that may have torque, and whose servos have not shown it for so long; the longest first."""
        until_s, seen, faults = self._clock.now() - for_s, self._shown_s, self._faults
        limp = {name for name, fault in faults.items() if fault.kind == "no_torque"}
        unseen = [joint for joint in self._joints if joint.name in measured and joint.name not in limp]
        return sorted((one for one in unseen if seen[one.name] <= until_s), key=lambda joint: seen[joint.name])

    def _rejoin(self, name: str) -> None:
        del self._faults[name]
        self._heard_s.pop(name, None)
        self.withheld.discard(name)

    def _refuse(self, joint: Joint, buses: JointBuses, what: str) -> None:
        name = joint.name
        former = self._faults.get(name)
        if former is None or former.kind != "no_torque":
            text = f"{what}: {REBOOT if name in self._latched else 'activate again'}"
            self.log.note(logging.ERROR, buses.label(joint), joint.servo_id, text)
            self._faults[name] = JointFault("no_torque", text)
        self._heard_s[name] = -math.inf
        self.withheld.add(name)


def _called(joint: Joint, buses: JointBuses) -> str:
    return f"{buses.label(joint)}: servo {joint.servo_id}"
