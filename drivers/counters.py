"""What went wrong on a bus, counted for each servo and each kind of fault since the bus was opened."""

from dataclasses import dataclass, field
from typing import Final

_KINDS: Final = ("replies", "silent", "corrupt", "late", "refused", "reset", "alarms", "retries", "skipped")


@dataclass(slots=True)
class WholeBursts:
    """How often certain servos have all answered one question: counted once, not for each of them."""

    count: int = 0


@dataclass(slots=True)
class ServoCounters:
    """One servo's account. Every reply that was asked for ends in one of the first five or is a good one."""

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
    alarms: int = 0
    """Good replies whose status byte named a trouble."""
    retries: int = 0
    """Asked once more within the same cycle."""
    skipped: int = 0
    """Known to be silent, and not asked in this cycle."""
    single_replies: int = 0
    """Good ones, where somebody else's was not."""
    whole_bursts: list[WholeBursts] = field(default_factory=list)
    """Of the questions that it was asked together with others: each holds a good reply of this servo too."""

    @property
    def replies(self) -> int:
        """Good ones."""
        return self.single_replies + sum(bursts.count for bursts in self.whole_bursts)

    def missed(self, counted_as: str) -> None:
        """A question ended without a value."""
        self.silent += counted_as == "silent"
        self.corrupt += counted_as == "corrupt"

    def came_late(self, counted_as: str) -> None:
        """A reply that was given up as ``silent``, ``corrupt`` or ``refused`` came after all."""
        self.silent -= counted_as == "silent"
        self.corrupt -= counted_as == "corrupt"
        self.refused -= counted_as == "refused"
        self.late += 1

    def as_dict(self) -> dict[str, int]:
        """Every counter by name."""
        return {name: getattr(self, name) for name in _KINDS}


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
        account = self.servos.get(servo_id)
        if account is None:
            account = self.servos[servo_id] = ServoCounters()
        return account

    def whole_bursts(self, servo_ids: tuple[int, ...]) -> WholeBursts:
        """A count of questions that these have all answered."""
        bursts = WholeBursts()
        for servo_id in servo_ids:
            self.of(servo_id).whole_bursts.append(bursts)
        return bursts

    def faults(self) -> dict[str, int]:
        """Faults by kind, summed over all servos."""
        accounts = list(self.servos.values())
        return {
            "silent": sum(a.silent for a in accounts),
            "corrupt": sum(a.corrupt for a in accounts),
            "late": sum(a.late for a in accounts),
            "refused": sum(a.refused for a in accounts),
            "reset": sum(a.reset for a in accounts),
            "alarms": sum(a.alarms for a in accounts),
            "retries": sum(a.retries for a in accounts),
            "skipped": sum(a.skipped for a in accounts),
            "noise": self.noise,
            "strange": self.strange,
        }
