"""Track which joints are affected by injected faults, and when. A fault may exempt only these joints from
invariants."""

import math
from collections import defaultdict
from collections.abc import Iterable, Sequence

from drivers.clock import Clock
from hal.joint import Joint
from sim_backend.faults.event import Event
from sim_backend.faults.player import FaultPlayer

FACTORY_ID = 1
"""ID of a servo that has lost its settings."""


class Touches:
    """Types and times of the faults that have affected each joint. Call ``update`` at least once per cycle."""

    def __init__(self, joints: Sequence[Joint], player: FaultPlayer, clock: Clock) -> None:
        self._joints, self._player, self._clock = tuple(joints), player, clock
        self._seen = 0
        self._updated_s = -math.inf
        self._last_s = defaultdict[str, dict[str, float]](dict)
        """Time at which each type of fault last affected each joint, keyed by joint name and fault type."""
        self._events = defaultdict[str, list[Event]](list)

    def update(self) -> None:
        """Record the faults that were active since the last call."""
        happened, now_s = self._player.happened, self._clock.now()
        if now_s == self._updated_s and len(happened) == self._seen:
            return
        recent = happened[self._seen :]
        self._seen, self._updated_s = len(happened), now_s
        for event in recent:
            for joint in touched_joints(event, self._joints):
                self._events[joint].append(event)
        if not recent and not self._player.active:
            return
        for event in (*self._player.active.values(), *recent):
            for joint in touched_joints(event, self._joints):
                self._last_s[joint][event.kind] = now_s

    def since_s(self, joint: str, kinds: Iterable[str] | None = None) -> float:
        """Return the time since a fault last affected a joint, in seconds, or infinity if no fault has affected the
        joint.

        ``kinds`` are the fault types to consider; None for all types.
        """
        self.update()
        last_s = self._last_s[joint]
        times = last_s.values() if kinds is None else [last_s[kind] for kind in kinds if kind in last_s]
        return self._clock.now() - max(times, default=-math.inf)

    def events(self, joint: str) -> Sequence[Event]:
        """Return the faults that have affected a joint so far. A fault that has ended is listed twice."""
        self.update()
        return self._events[joint]

    def kinds(self, joint: str) -> set[str]:
        """Return the types of faults that have affected a joint so far."""
        self.update()
        return set(self._last_s[joint])


def touched_joints(event: Event, joints: Sequence[Joint]) -> set[str]:
    """Return the joints whose servo, bus or replies an event affects. Faults of the computer do not affect any
    joint."""
    servo_id, bus = getattr(event, "servo_id", None), getattr(event, "bus", None)
    if servo_id is None and not hasattr(event, "bus"):
        return set()
    on_line = [joint for joint in joints if bus in (None, joint.bus)]
    if servo_id is None:
        return {joint.name for joint in _downstream(getattr(event, "after", None), on_line)}
    also = {getattr(event, "to", None), getattr(event, "other", None)}
    if event.kind == "eeprom_gone":
        also.add(FACTORY_ID)
    return {joint.name for joint in on_line if joint.servo_id in {servo_id, *also}}


def _downstream(after: int | None, joints: Sequence[Joint]) -> Sequence[Joint]:
    """Return the joints after a servo in the daisy chain, or all joints if the cable breaks before the first servo."""
    places = [place for place, joint in enumerate(joints) if joint.servo_id == after]
    return joints[places[0] + 1 :] if places else joints
