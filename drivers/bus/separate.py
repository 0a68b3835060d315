"""Read and write servos one by one if they do not support group instructions. This is the last resort.

Custom-built servos with a microcontroller often respond only to pings, reads and writes. These servos are detected
outside the control cycle. From then on, each cycle sends such a servo a read and an acknowledged write.
"""

import logging
from collections.abc import Iterable, Mapping
from typing import Final

from drivers.bus.adaptive_timeout import AdaptiveTimeout
from drivers.bus.counters import BusCounters
from drivers.bus.group_read import GroupRead
from drivers.bus.known_servos import KnownServos
from drivers.bus.state_reader import StateReader
from drivers.port.line import Line
from drivers.printable import counted
from drivers.protocol import v2
from drivers.types import Reading, ServoFault, ServoGoal, ServoState

LOG = logging.getLogger("servoloop.drivers")

TRIALS: Final = 6
"""Number of consecutive failures that prove that a servo does not support group reads. A failure is a group read
without a reply, followed by a single read with a reply. On a bus that loses 9 % of the packets in each direction, this
happens by chance once in 40,000 trials.
"""
WRITE_TRIES: Final = 2
"""Number of attempts to write a goal in one cycle."""


class SeparateServos:
    """The servos of one bus that do not support group instructions."""

    def __init__(
        self, line: Line, servos: KnownServos, reader: StateReader, group: GroupRead, counters: BusCounters
    ) -> None:
        self._line, self._servos, self._reader = line, servos, reader
        self._group, self._counters = group, counters
        self._doubtful: set[int] = set()
        """Identified servos that have not yet replied to a group read."""
        self._reported: frozenset[int] = frozenset()

    def identified(self, servo_id: int) -> None:
        """Record that a servo has replied to single reads."""
        if self._servos.protocol.group_read == "sync" and servo_id not in self._servos.separate:
            self._doubtful.add(servo_id)

    def found(self, readings: Mapping[int, Reading]) -> bool:
        """Examine the identified servos that did not report a state.

        Return whether one of these servos must be read separately.
        """
        if not self._doubtful:
            return False
        self._doubtful -= {i for i, reading in readings.items() if isinstance(reading, ServoState)}
        missing = [i for i, reading in readings.items() if i in self._doubtful and _unanswered(reading)]
        return bool([servo_id for servo_id in missing if self.examine(servo_id)])

    def examine(self, servo_id: int) -> bool:
        """Return whether a servo responds to single reads but not to group reads.

        Such a servo is then read separately in every cycle.
        """
        if servo_id in self._servos.separate:
            return True
        if self._servos.protocol.group_read != "sync":
            return False
        for _ in range(TRIALS):
            if not _unanswered(self._reader.ask(servo_id)) or not self._answers_alone(servo_id):
                self._servos.set_separate(servo_id, False)
                return False
            self._servos.set_separate(servo_id, False)
        self._servos.set_separate(servo_id, True)
        self._doubtful.discard(servo_id)
        self._group.adaptive = True
        self._measure(servo_id)
        return True

    def _measure(self, servo_id: int) -> None:
        """Measure how long replies take. Replies that may be late replies to the group reads are not measured."""
        for _ in self._servos.blocks(servo_id):
            self._reader.ask(servo_id)
        self._group.timeout = AdaptiveTimeout()
        self._reader.ask(servo_id)

    def _answers_alone(self, servo_id: int) -> bool:
        self._servos.set_separate(servo_id, True)
        return any(isinstance(self._reader.ask(servo_id), ServoState) for _ in range(2))

    def write_goal(self, servo_id: int, goal: ServoGoal) -> None:
        """Write the goal of one servo and wait for the acknowledgment. Raises ValueError if the goal does not fit."""
        line, request = self._line, self._servos.goal_packet(servo_id, goal)
        size, account = self._servos.protocol.packets.OVERHEAD, self._counters.of(servo_id)
        for attempt in range(WRITE_TRIES):
            account.retries += attempt > 0
            if not line.clean:
                line.port.discard_input()
            until_s = line.send_request(request) + size * line.byte_s + self._group.timeout.wait_s(attempt == 0)
            error = self._error_of(servo_id, line.receive(request, size, until_s))
            if error is not None:
                line.clean = True
                account.refused += bool(error & self._servos.protocol.refusals)
                return
        account.silent += 1

    def _error_of(self, servo_id: int, data: bytes) -> int | None:
        """Return the error byte of an acknowledgment, or None if the bytes are not an acknowledgment from this
        servo."""
        packets = self._servos.protocol.packets
        if len(data) != packets.OVERHEAD:
            return None
        error = data[8] if packets is v2 else data[4]
        parts = (packets.STATUS, bytes((error,))) if packets is v2 else (error, b"")
        return error if data == packets.packet(servo_id, *parts) else None

    def size(self, goals: Mapping[int, ServoGoal]) -> int:
        """Return the number of bytes needed to write these goals separately, including the acknowledgments."""
        acknowledgment: int = self._servos.protocol.packets.OVERHEAD
        written = [i for i in goals if i in self._servos.written_alone]
        return sum(len(self._servos.goal_packet(i, goals[i])) + acknowledgment for i in written)

    def report(self, servo_ids: Iterable[int]) -> None:
        """Log a warning with the highest possible cycle rate, once for each set of separate servos."""
        asked = tuple(servo_ids)
        alone = frozenset(self._servos.written_alone.intersection(asked))
        if not alone - self._reported:
            return
        self._reported = alone
        cycle_s = self._cycle_s(asked)
        names = ", ".join(map(str, sorted(alone)))
        subject = f"servos {names} do not support" if len(alone) > 1 else f"servo {names} does not support"
        reads = alone & self._servos.separate
        LOG.warning(
            "%s: %s %s, so each cycle uses single requests. A cycle of %s takes %.1f ms and limits the rate to %d "
            "Hz: set a lower update_rate, or use servos that support group instructions",
            self._line.port.name, subject, "group reads and writes" if reads else "group writes",
            counted(len(asked), "servo"), 1e3 * cycle_s, int(1.0 / cycle_s),
        )  # fmt: skip

    def _cycle_s(self, servo_ids: tuple[int, ...]) -> float:
        """Return the duration of a cycle that reads these servos and writes their goals, if no packets are lost."""
        goals = dict.fromkeys(servo_ids, ServoGoal(0))
        size = self._reader.exchange_size(servo_ids) + len(self._servos.goals(goals)) + self.size(goals)
        separate = self._servos.separate.intersection(servo_ids)
        requests = len(separate) + bool(set(servo_ids) - separate) + len(self._servos.written_alone & set(servo_ids))
        return size * self._line.byte_s + requests * self._group.timeout.slowest_s


def _unanswered(result: object) -> bool:
    """Return whether a servo did not reply to a group read or rejected it."""
    return result == "silent" or (isinstance(result, ServoFault) and result.kind in ("silent", "refused"))
