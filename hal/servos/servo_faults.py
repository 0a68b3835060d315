"""Track silent servos and servos whose torque is no longer enabled, and decide when a servo may receive goals again."""

import logging
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from drivers.clock import Clock
from drivers.servos.catalog import series_of
from drivers.types import ServoFault
from hal.joint import Joint
from hal.servos.fault_log import FaultLog
from hal.servos.joint_buses import JointBuses
from hal.types import JointFault

LOG = logging.getLogger("servoloop.hal")

RESET_S: Final = 0.1
"""Minimum duration of silence after which a servo receives no goals until its torque has been checked, in seconds.

According to Feetech's manual a restart takes 0.8 s. A faster restart is detected, because the servo loses its torque
limit.
"""
WATCH_S: Final = 0.35
"""Period in which the torque of every servo is checked once, because a servo may lose its torque without raising an
alarm."""
MISSED: Final = 1.2
"""Maximum time between two checks of a servo, as a multiple of ``WATCH_S``. After this time, a servo is checked in the
next cycle that has time left.
"""
LATEST: Final = 1.4
"""Time since the last check after which a servo is checked even if this makes the cycle late, as a multiple of
``WATCH_S``.

An occasional late cycle is better than a limp joint that goes unnoticed, or a joint that never receives goals again."""
QUICK_S: Final = 0.008
"""Maximum response time at which only one servo is checked in a late cycle, so that the next cycle is on time.

On a slower bus, all servos are checked at once, because the adapter delays all their replies together."""
LATE_S: Final = 0.08
"""Maximum delay of a late cycle: two checks through an adapter that delays replies. The value must be less than
``RESET_S``.
"""
RELEASING_ALARMS: Final = ("current", "temperature")
"""Alarms that cause a servo to release its torque. A goal would re-enable the torque, either immediately or after the
servo has cooled down.
"""
REBOOT: Final = "reboot it (servoloop reboot), then activate again; the port is free once this program has exited"
"""Remedy for a servo that has shut down and does not enable torque until it is rebooted."""
NO_TIME_AGAIN_S: Final = 1.0
"""Minimum time between two log messages about cycles that had no time left for servos, in seconds.

If the rate is too high for the bus, such cycles are frequent, and each log message takes more time."""
_UNASKED: Final = "responds again, but its torque has not been checked yet: it receives no goals until then"


class ServoFaults:
    """Faults of one component's servos.

    A silent servo has a fault until it responds again. If the component is active, the servo's torque is checked first,
    because most servos enable torque when they receive a goal. A servo whose torque is disabled must be activated
    again.
    """

    def __init__(self, joints: Sequence[Joint], clock: Clock) -> None:
        self.withheld: set[str] = set()
        """Joints whose servos must not receive goals."""
        self.log = FaultLog()
        """Log of the events of a cycle."""
        self._joints = tuple(joints)
        self._clock = clock
        self._faults: dict[str, JointFault] = {}
        self._released: dict[str, str] = {}
        """Messages about servos that have released their torque to protect themselves, keyed by joint name."""
        self._latched: dict[str, str] = {}
        """Alarms that last until a reboot, keyed by joint name."""
        self._unlogged: set[str] = set()
        """Joints that were not measured because the cycle had no time left, and that have not been logged yet."""
        self._no_time_logged_s = -math.inf
        """Time of the first measurement in the last cycle for which a lack of time was logged, in seconds."""
        self._measured_s: dict[str, float] = {}
        """Time of the last measurement of each missing servo, keyed by joint name."""
        self._checked_s: dict[str, float] = {}
        """Time at which each servo was last found with its torque enabled, or last found missing, keyed by joint
        name."""
        self._next = 0
        self._next_s = self._next_late_s = 0.0
        self._quick = True
        """Whether the checks in the last late cycle took less than ``QUICK_S``."""

    def forget(self) -> None:
        """Discard all faults."""
        self._faults.clear()
        self._released.clear()
        self._latched.clear()
        self._measured_s.clear()
        self._unlogged.clear()
        self.withheld.clear()

    @property
    def named(self) -> frozenset[str]:
        """Joints that have a fault or do not receive goals."""
        return frozenset(self._faults) | self.withheld

    @property
    def limp(self) -> frozenset[str]:
        """Joints whose servos were found with their torque disabled, and have not been activated again."""
        return frozenset(name for name, fault in self._faults.items() if fault.kind == "no_torque")

    def reactivated(self, names: Iterable[str]) -> None:
        """Discard the faults of joints that have been reactivated."""
        known = set(names)
        names = [joint.name for joint in self._joints if joint.name in known]
        for name in names:
            for facts in (self._faults, self._released, self._latched, self._measured_s):
                facts.pop(name, None)
            self._unlogged.discard(name)
            self.withheld.discard(name)
            self._checked_s[name] = self._clock.now()
        if names:
            one = len(names) == 1
            ends = "the joint holds its position" if one else "the joints hold their positions"
            LOG.warning("%s: torque is enabled again, and %s", ", ".join(names), ends)

    def ask_all(self, buses: JointBuses) -> frozenset[str]:
        """Check the torque of all servos without a fault. A servo whose torque is disabled gets a fault.

        Returns:
            The joints whose servos did not respond.
        """
        begin_s = self._clock.now()
        try:
            self._watch([joint for joint in self._joints if joint.name not in self.named], buses, begin_s + LATE_S)
        finally:
            self.log.flush()
        named, checked = self.named, self._checked_s
        return frozenset(n for n in (j.name for j in self._joints) if n not in named and checked.get(n, 0.0) < begin_s)

    def note_missing(self, joint: Joint, fault: ServoFault | JointFault, measured_s: float, buses: JointBuses) -> None:
        """Record that a servo did not report a state, or reported an implausible one.

        Args:
            joint: The joint.
            fault: The fault.
            measured_s: Time of the last measurement.
            buses: Buses of the joints.
        """
        name = joint.name
        found = JointFault(fault.kind, fault.text)
        if found.kind == "implausible" and name in self._faults and self._faults[name].kind == "no_torque":
            return  # a limp joint may be moved by hand, and must keep its no_torque fault
        begins = name not in self._faults or (name in self._unlogged and found.kind != "no_time")
        if begins:
            self._log_missing(joint, found, measured_s, buses)
        self._faults[name] = found
        self._checked_s[name] = self._clock.now()
        if self._clock.now() - self._measured_s.setdefault(name, measured_s) >= RESET_S:
            self.withheld.add(name)

    def _log_missing(self, joint: Joint, found: JointFault, measured_s: float, buses: JointBuses) -> None:
        """Log a new fault. A lack of time is logged at most once per second, for all affected joints of the cycle."""
        if found.kind == "no_time":
            if 0.0 < measured_s - self._no_time_logged_s < NO_TIME_AGAIN_S:
                self._unlogged.add(joint.name)
                return
            self._no_time_logged_s = measured_s
        self._unlogged.discard(joint.name)
        if found not in self._faults.values():  # the fault of a whole bus is logged once
            self.log.note(logging.ERROR, buses.label(joint), joint.servo_id, found.text)

    def note_alarms(self, joint: Joint, alarms: Sequence[str], buses: JointBuses) -> None:
        """Record the alarms of a servo in an active component. Some alarms cause a servo to release its torque."""
        if series_of(joint.model).hardware_error:
            self._latched[joint.name] = f"{', '.join(alarms)} alarm"
        releasing = [alarm for alarm in alarms if alarm in RELEASING_ALARMS]
        if releasing and joint.name not in self._released:
            self._released[joint.name] = (
                f"{_servo_label(joint, buses)} released its torque ({', '.join(releasing)} alarm)"
            )
            self._refuse(joint, buses, self._released[joint.name])

    def present(
        self, measured: Mapping[str, int], buses: JointBuses, ask_until_s: float | None
    ) -> dict[str, JointFault]:
        """Return the faults after a cycle.

        If the component is active, the torque of some servos is checked first: servos whose turn it is, and servos that
            have started to respond again. If no time is left, these servos are checked in a later cycle.

        Args:
            measured: Measured counts, keyed by joint name.
            buses: Buses of the joints.
            ask_until_s: Clock time until which servos may be checked; None if the component is not active.

        Returns:
            Faults, keyed by joint name.
        """
        faults = self._faults
        back = [joint for joint in self._joints if joint.name in faults and joint.name in measured] if faults else []
        for joint in back:
            if joint.name not in self.withheld:  # the next time the servo is silent, a new period starts
                self._measured_s.pop(joint.name, None)
        if ask_until_s is None:
            for joint in back:
                self._rejoin(joint.name)
            self._checked_s = dict.fromkeys((joint.name for joint in self._joints), self._clock.now())
        else:
            for joint in [joint for joint in back if joint.name in self._released]:
                # This replaces the fault if the servo was silent in between.
                self._refuse(joint, buses, self._released[joint.name])
            begin_s, late = self._clock.now(), self._overdue(measured)
            until_s = begin_s + LATE_S if late else ask_until_s
            if back:
                self._ask([joint for joint in back if joint.name not in self._released], buses, until_s)
            due = self._due(measured, 0.0 if late else MISSED * WATCH_S)
            due = [joint for joint in due if joint.name not in self._faults]
            if due:
                self._watch(due[:1] if late and self._quick else due, buses, until_s)
            if late:
                was_quick, self._quick = self._quick, self._clock.now() - begin_s < QUICK_S
                self._next_late_s = begin_s + (0.0 if was_quick else LATEST * WATCH_S)
        if not self._faults:
            return {}
        unasked = {
            joint.name: JointFault("no_torque", f"{_servo_label(joint, buses)} {_UNASKED}")
            for joint in back
            if joint.name in self.withheld and self._faults[joint.name].kind != "no_torque"
        }
        return {n: f for n, f in self._faults.items() if n not in measured or f.kind == "no_torque"} | unasked

    def _overdue(self, measured: Mapping[str, int]) -> bool:
        """Return whether a check must be done in this cycle even if it makes the cycle late."""
        return self._clock.now() >= self._next_late_s and bool(self._unseen(LATEST * WATCH_S, measured))

    def _driven(self, joints: Sequence[Joint], buses: JointBuses, ask_until_s: float) -> dict[str, bool]:
        found = buses.torque_states(joints, ask_until_s) if joints else {}
        self._checked_s |= dict.fromkeys(found, self._clock.now())
        return found

    def _ask(self, back: Sequence[Joint], buses: JointBuses, ask_until_s: float) -> None:
        """Check servos that have started to respond again. A servo that lost power is limp and must be activated
        again."""
        joints = {joint.name: joint for joint in back}
        for name, driven in self._driven(back, buses, ask_until_s).items():
            joint, called = joints[name], _servo_label(joints[name], buses)
            if driven:
                if name not in self._unlogged:
                    self.log.note(logging.WARNING, buses.label(joint), joint.servo_id, f"{called} responds again")
                self._rejoin(name)
            else:
                why = self._latched.get(name, "power dip?")
                self._refuse(joint, buses, f"{called} returned with its torque disabled ({why})")

    def _watch(self, due: Sequence[Joint], buses: JointBuses, ask_until_s: float) -> None:
        driven = self._driven(due, buses, ask_until_s)
        limp = [joint for joint in due if driven.get(joint.name) is False]
        # Check twice, because the first reply may answer a request from another program on the bus.
        again = self._driven(limp, buses, ask_until_s)
        for joint in limp:
            if not again.get(joint.name):
                why = self._latched.get(joint.name, "current protection, power dip?")
                self._refuse(joint, buses, f"{_servo_label(joint, buses)} has lost its torque ({why})")

    def _due(self, measured: Mapping[str, int], missed_s: float) -> list[Joint]:
        """Return the joints to check in this cycle: joints that missed their turn, and joints whose turn it is."""
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
        """Return the joints whose torque has not been checked for ``for_s`` seconds, starting with the longest
        unchecked."""
        until_s, checked = self._clock.now() - for_s, self._checked_s
        if min(checked.values(), default=math.inf) > until_s:  # the usual case, and much faster
            return []
        driven = measured.keys() - self.limp
        unseen = [joint for joint in self._joints if joint.name in driven]
        return sorted((one for one in unseen if checked[one.name] <= until_s), key=lambda joint: checked[joint.name])

    def _rejoin(self, name: str) -> None:
        del self._faults[name]
        self._measured_s.pop(name, None)
        self._unlogged.discard(name)
        self.withheld.discard(name)

    def _refuse(self, joint: Joint, buses: JointBuses, reason: str) -> None:
        name = joint.name
        former = self._faults.get(name)
        if former is None or former.kind != "no_torque":
            text = f"{reason}: {REBOOT if name in self._latched else 'activate again'}"
            self.log.note(logging.ERROR, buses.label(joint), joint.servo_id, text)
            self._faults[name] = JointFault("no_torque", text)
        self._measured_s[name] = -math.inf
        self._unlogged.discard(name)
        self.withheld.add(name)


def _servo_label(joint: Joint, buses: JointBuses) -> str:
    return f"{buses.label(joint)}: servo {joint.servo_id}"
