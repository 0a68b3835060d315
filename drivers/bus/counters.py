"""The faults of a bus, counted for each servo and each kind of fault since the bus was opened."""

from dataclasses import asdict, dataclass, field, fields


@dataclass(slots=True)
class ServoCounters:
    """One servo's account. Every question to it ends in one of the first seven."""

    replies: int = 0
    """Good ones."""
    silent: int = 0
    """Asked, and nothing came in time."""
    corrupt: int = 0
    """Asked, and what came had a wrong checksum or no header."""
    late: int = 0
    """Asked, and what came was the answer to an earlier request, or may have been."""
    refused: int = 0
    """Asked, and what came says that the servo cannot or does not want to answer."""
    reset: int = 0
    """Asked, and what came shows that the servo has lost its memory."""
    no_time: int = 0
    """Asked or not, and the cycle was over before an answer could have come."""
    alarms: int = 0
    """Good replies whose status byte named a trouble."""
    retries: int = 0
    """Asked once more within the same cycle."""
    skipped: int = 0
    """Known to be silent, and not asked in this cycle."""
    implausible: int = 0
    """Good replies whose position the servo cannot have reached since the reply before."""

    def add(self, kind: str) -> None:
        """A question ended without a value."""
        setattr(self, kind, getattr(self, kind) + 1)

    def came_late(self, counted_as: str) -> None:
        """A reply that was given up, and counted as this kind, came after all."""
        setattr(self, counted_as, getattr(self, counted_as) - 1)
        self.late += 1

    def as_dict(self) -> dict[str, int]:
        """Every counter by name."""
        return asdict(self)


@dataclass(slots=True)
class BusCounters:
    """The whole line's account. What no servo can be blamed for is counted beside the servos."""

    noise: int = 0
    """Pieces of garbage before, between or after replies."""
    strange: int = 0
    """Good replies that nobody had asked for, or that came twice."""
    servos: dict[int, ServoCounters] = field(default_factory=dict)

    def of(self, servo_id: int) -> ServoCounters:
        """The account of one servo, opened with the first question."""
        return self.servos.setdefault(servo_id, ServoCounters())

    def faults(self) -> dict[str, int]:
        """Faults by kind, summed over all servos."""
        kinds = [each.name for each in fields(ServoCounters) if each.name != "replies"]
        summed = {kind: sum(getattr(account, kind) for account in self.servos.values()) for kind in kinds}
        return {**summed, "noise": self.noise, "strange": self.strange}
