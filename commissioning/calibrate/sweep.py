"""Record the sweep of joints from stop to stop, in continuous counts.

The sweep may begin in any pose, and the encoder's seam may be anywhere in the travel. Each reading is interpreted as
the continuous count nearest to the previous reading.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from commissioning.commissioning_errors import CalibrationError
from drivers.bus.bus import Bus
from drivers.servos.angles import Travel, unwrap
from drivers.types import Reading, ServoState
from hal.joint import Joint


@dataclass(slots=True)
class Swept:
    """Sweep of one joint so far, in continuous counts."""

    counts: int
    lower: int
    upper: int
    readings: int = 1
    recent: tuple[int, ...] = ()
    """Up to three readings, in chronological order. The median of the readings is used, because one of them may be
    wrong."""

    @property
    def travel(self) -> Travel:
        """Range that the joint has covered so far."""
        return Travel(self.lower, self.upper)

    def take(self, reading: int, turn: int) -> None:
        """Add the next reading. ``turn`` is the number of counts per turn."""
        recent = self.recent or (self.counts,)
        self.counts = unwrap(sorted(recent)[len(recent) // 2], reading, turn)
        self.recent = (*recent[-2:], self.counts)
        self.readings += 1
        median = sorted(self.recent)[1]
        if self.readings <= len(self.recent):  # The first readings are not confirmed yet.
            self.lower = self.upper = median
        self.lower, self.upper = min(self.lower, median), max(self.upper, median)


class Sweep:
    """Simultaneous sweeps of all joints on one bus."""

    def __init__(self, bus: Bus, joints: Sequence[Joint]) -> None:
        self.joints = tuple(joints)
        self.swept: dict[str, Swept] = {}
        """Sweep of each joint whose servo has replied, keyed by joint name."""
        self.missing: dict[str, str] = {}
        """Error message for each joint whose servo did not reply to the last read, keyed by joint name."""
        self._bus = bus

    def update(self) -> None:
        """Read all servos once. A servo that does not respond is added to ``missing``, and its sweep is kept."""
        readings = self._bus.read_states([joint.servo_id for joint in self.joints])
        self.missing = {}
        for joint in self.joints:
            self._take(joint, readings)

    def of(self, joint: Joint) -> Swept:
        """Return the sweep of one joint. Raises CalibrationError if its servo has never answered."""
        swept = self.swept.get(joint.name)
        if swept is None:
            raise CalibrationError(
                f"{joint.name}: servo {joint.servo_id} has never responded ({self.missing.get(joint.name, '')}). "
                "Run servoloop doctor to find the cause"
            )
        return swept

    def _take(self, joint: Joint, readings: Mapping[int, Reading]) -> None:
        reading = readings[joint.servo_id]
        if not isinstance(reading, ServoState):
            self.missing[joint.name] = reading.text
            return
        counts, known = reading.position_counts, self.swept.get(joint.name)
        if known is None:
            self.swept[joint.name] = Swept(counts, counts, counts)
        else:
            known.take(counts, joint.model.counts_per_turn)


def last_way(counts: Iterable[int], threshold: int) -> int:
    """Return the signed distance of the joint's last motion in one direction, in counts.

    Reversals of at most ``threshold`` counts are ignored. Only the last motion is used, because the user may first have
    to move the joint away from a stop. The result is 0 if no motion exceeded ``threshold``.
    """
    origin = turning = last = None
    way = 0
    for count in counts:
        if origin is None or turning is None:
            origin = turning = last = count
            continue
        last = count
        if way == 0:
            way = _sign(count - origin) if abs(count - origin) > threshold else 0
            turning = count if way else turning
        elif (count - turning) * way >= 0:
            turning = count
        elif abs(count - turning) > threshold:
            origin, turning, way = turning, count, -way
    return 0 if way == 0 or origin is None or last is None else last - origin


def _sign(value: int) -> int:
    return (value > 0) - (value < 0)
