"""What a bus says of its servos: states, faults, goals."""

from typing import Literal, NamedTuple

FaultKind = Literal["silent", "corrupt", "late", "refused", "reset", "no_time"]
"""No reply; one that does not hold together; a stale one, which belongs to an earlier request; one that says that
the question cannot be answered; one that shows that the servo has lost its memory, so its torque and its goal too;
none, and the cycle was over before one could have come: that is no fault of the servo's."""

TEXTS: dict[FaultKind, str] = {
    "silent": "does not answer",
    "corrupt": "answered with a wrong checksum",
    "late": "answers too late",
    "refused": "refuses to be read",
    "reset": "has lost the map of its indirect registers, as after a reboot: no value was made of its answer",
    "no_time": "was not measured: the cycle had no time left",
}


class ServoState(NamedTuple):
    """One servo's state from one reply. ``alarms`` are the names of the status bits that are set.

    A tuple, because a cycle makes one for every servo and a frozen dataclass takes four times as long.
    """

    position_counts: int
    velocity_counts_s: int
    load: float
    """Drive as a share of full drive, -1 to 1."""
    voltage_v: float
    temperature_c: float
    alarms: tuple[str, ...] = ()
    current_a: float | None = None
    """Of the motor, negative where it drives backwards; None where it is not among what is read."""


class ServoFault(NamedTuple):
    """Why there is no state."""

    kind: FaultKind
    text: str


Reading = ServoState | ServoFault


class ServoGoal(NamedTuple):
    """Where to go, and how fast: ``velocity_counts_s`` 0 means as fast as the servo can."""

    position_counts: int
    velocity_counts_s: int = 0


def fault(servo_id: int, kind: FaultKind, why: str = "") -> ServoFault:
    """A fault, with its text in one form for all."""
    return ServoFault(kind, f"servo {servo_id} {TEXTS[kind]}{why and ': '}{why}")
