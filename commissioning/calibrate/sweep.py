"""The sweep: joints are moved from stop to stop, and their servos' readings become continuous counts.

No middle pose is needed to begin from, and the encoder's seam may lie anywhere in the travel: a reading is taken to be
the one nearest to the reading before.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from calibration.angles import Travel, unwrap
from commissioning.calibrate.result import CalibrationError
from drivers.bus.bus import Bus
from drivers.bus.types import Reading, ServoState
from hal.joint import Joint


@dataclass(slots=True)
class Swept:
    """One joint's sweep so far, in continuous counts."""

    counts: int
    lower: int
    upper: int
    readings: int = 1
    recent: tuple[int, ...] = ()
    """Up to three readings, the newest last. Their median counts, because one of them may be false."""

    @property
    def travel(self) -> Travel:
        """From end to end."""
        return Travel(self.lower, self.upper)

    def take(self, reading: int, turn: int) -> None:
        """Note the next reading."""
        recent = self.recent or (self.counts,)
        self.counts = unwrap(sorted(recent)[len(recent) // 2], reading, turn)
        self.recent = (*recent[-2:], self.counts)
        self.readings += 1
        median = sorted(self.recent)[1]
        if self.readings <= len(self.recent):  # nothing has confirmed the first readings yet
            self.lower = self.upper = median
        self.lower, self.upper = min(self.lower, median), max(self.upper, median)


class Sweep:
    """The sweeps of all joints on one bus, side by side."""

    def __init__(self, bus: Bus, joints: Sequence[Joint]) -> None:
        self.joints = tuple(joints)
        self.swept: dict[str, Swept] = {}
        """By joint, as soon as its servo has answered."""
        self.missing: dict[str, str] = {}
        """Joints whose servos did not answer the last time, and why."""
        self._bus = bus

    def look(self) -> None:
        """Read all servos once. One that does not answer keeps what is known of it, and is named."""
        readings = self._bus.read_states([joint.servo_id for joint in self.joints])
        self.missing = {}
        for joint in self.joints:
            self._take(joint, readings)

    def of(self, joint: Joint) -> Swept:
        """What is known of one joint. Raises CalibrationError where its servo has never answered."""
        swept = self.swept.get(joint.name)
        if swept is None:
            raise CalibrationError(
                f"{joint.name}: servo {joint.servo_id} never answered ({self.missing.get(joint.name, '')}): "
                "servoloop doctor finds out why"
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
    """How far the joint went after it last turned round by more than ``threshold`` counts, with the sign.

    Somebody may first have to go back from a stop to show which way is positive: only the last way counts. 0 where
    there was no motion of more than ``threshold``.
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
