"""Count the replies and faults of a bus since it was opened, by servo and type."""

from dataclasses import asdict, dataclass, field, fields


@dataclass(slots=True)
class ServoCounters:
    """Counters of one servo. Every request increments one of the first seven counters."""

    replies: int = 0
    """Valid replies."""
    silent: int = 0
    """Requests that did not receive a reply in time."""
    corrupt: int = 0
    """Requests whose reply had a wrong checksum or no header."""
    late: int = 0
    """Requests whose only reply may belong to an earlier request."""
    refused: int = 0
    """Requests that the servo rejected."""
    reset: int = 0
    """Requests whose reply shows that the servo was reset."""
    no_time: int = 0
    """Requests that were sent or planned in a cycle that ended before a reply was possible."""
    alarms: int = 0
    """Valid replies whose status byte reports an alarm."""
    retries: int = 0
    """Requests repeated within the same cycle."""
    skipped: int = 0
    """Cycles in which no request was sent because the servo is known to be silent."""
    implausible: int = 0
    """Valid replies with a position that the servo cannot have reached since its previous reply."""

    def add(self, kind: str) -> None:
        setattr(self, kind, getattr(self, kind) + 1)

    def count_late(self, counted_as: str) -> None:
        """Count a late reply in place of the fault that was counted for its request."""
        setattr(self, counted_as, getattr(self, counted_as) - 1)
        self.late += 1

    def as_dict(self) -> dict[str, int]:
        return asdict(self)


@dataclass(slots=True)
class BusCounters:
    """Counters of a bus and its servos."""

    noise: int = 0
    """Sequences of garbage bytes before, between or after replies."""
    strange: int = 0
    """Valid replies that were not requested or that arrived twice."""
    servos: dict[int, ServoCounters] = field(default_factory=dict)

    def of(self, servo_id: int) -> ServoCounters:
        """Return the counters of one servo. The first call for a servo creates its counters."""
        return self.servos.setdefault(servo_id, ServoCounters())

    def faults(self) -> dict[str, int]:
        """Return the number of faults of all servos, keyed by type."""
        kinds = [each.name for each in fields(ServoCounters) if each.name != "replies"]
        summed = {kind: sum(getattr(account, kind) for account in self.servos.values()) for kind in kinds}
        return {**summed, "noise": self.noise, "strange": self.strange}
