"""States, faults and goals of servos."""

from typing import Literal, NamedTuple

FaultKind = Literal["silent", "corrupt", "late", "refused", "reset", "no_time"]
"""``silent``: there was no reply. ``corrupt``: the reply is invalid. ``late``: the reply belongs to an earlier request.
``refused``: the servo rejects the request. ``reset``: the servo was reset, so its torque is disabled and its goal is
lost. ``no_time``: the cycle ended before a reply was possible, which is not the servo's fault."""

TEXTS: dict[FaultKind, str] = {
    "silent": "does not respond",
    "corrupt": "replied with a wrong checksum",
    "late": "responds too late",
    "refused": "rejects the read request",
    "reset": "has lost the mapping of its indirect registers, as after a reboot: its reply was discarded",
    "no_time": "was not measured: the cycle had no time left",
}


class ServoState(NamedTuple):
    """State of one servo, taken from one reply. ``alarms`` holds the names of the status bits that are set.

    This class is a named tuple, because each cycle creates an instance for every servo. Creating a frozen dataclass
    takes four times as long.
    """

    position_counts: int
    velocity_counts_s: int
    load: float
    """Motor drive as a fraction of full drive, -1 to 1."""
    voltage_v: float
    temperature_c: float
    alarms: tuple[str, ...] = ()
    current_a: float | None = None
    """Motor current, in A; negative when the motor drives backward. None if the current is not read."""


class ServoFault(NamedTuple):
    """Reason why a servo's state is missing."""

    kind: FaultKind
    text: str


Reading = ServoState | ServoFault


class ServoGoal(NamedTuple):
    """Goal position and velocity of a servo. A ``velocity_counts_s`` of 0 means the servo's maximum velocity."""

    position_counts: int
    velocity_counts_s: int = 0


def fault(servo_id: int, kind: FaultKind, why: str = "") -> ServoFault:
    return ServoFault(kind, f"servo {servo_id} {TEXTS[kind]}{why and ': '}{why}")
