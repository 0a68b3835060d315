"""What every bus says in the same words, and does in the same way, whatever its packets."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Final

from drivers.bus import FaultKind, Reading, ServoFault, ServoState
from drivers.clock import Clock
from drivers.counters import BusCounters
from drivers.errors import ServoRefused
from drivers.owed import HELD_S
from drivers.port import Port
from drivers.registers import ServoModel

Outcome = ServoState | FaultKind | ServoFault
"""What became of one question to one servo. A fault in words of its own is a refusal: the servo says why."""

RETRIES: Final = 2
"""How often a servo is asked again within one cycle, if there is time."""

_AT_ONCE: Final = 256
"""Bytes that are thrown away in one read."""

TEXTS: Final[Mapping[FaultKind, str]] = {
    "silent": "does not answer",
    "corrupt": "answered with a wrong checksum",
    "late": "answers too late",
    "refused": "refuses to be read",
    "reset": "has lost the map of its indirect registers, as after a reboot: no value was made of its answer",
}


def readings_of(asked: Sequence[int], outcome: Mapping[int, Outcome]) -> dict[int, Reading]:
    """In the order of the question; who was not asked this time is silent."""
    readings: dict[int, Reading] = {}
    for servo_id in asked:
        what = outcome.get(servo_id, "silent")
        readings[servo_id] = fault(servo_id, what, TEXTS[what]) if isinstance(what, str) else what
    return readings


def fault(servo_id: int, kind: FaultKind, text: str) -> ServoFault:
    """In one form for all."""
    return ServoFault(kind, f"servo {servo_id} {text}")


def refused(servo_id: int, why: str) -> ServoFault:
    """A reply that says that there is no answer, and why."""
    return fault(servo_id, "refused", f"{TEXTS['refused']}: {why}")


def count_skipped(counters: BusCounters, asked: Sequence[int], outcome: Mapping[int, Outcome]) -> None:
    """Who was not asked this time."""
    for servo_id in asked:
        if servo_id not in outcome:
            counters.of(servo_id).skipped += 1


def refuse_stranger(servo_id: int, number: int, model: ServoModel, models: Mapping[str, ServoModel]) -> None:
    """Raise ServoRefused unless the servo's number is its model's; ``models`` has the names of others."""
    if number == model.number:
        return
    known = next((m.name for m in models.values() if m.number == number), "unknown")
    raise ServoRefused(
        servo_id,
        f"is model {number} ({known}), not {model.number} ({model.name}): "
        "correct the model that it is said to be, or swap the servo",
    )


@contextmanager
def port_at(port: Port, clock: Clock, baud: int) -> Iterator[None]:
    """The port at another rate for a while. Raises PortError where the adapter cannot.

    What is still on the way then is an answer to this rate's questions, and not to be heard at the next.
    """
    former = port.baud
    port.set_baud(baud)
    try:
        yield
        _let_pass(port, clock)
    finally:
        port.set_baud(former)


def _let_pass(port: Port, clock: Clock) -> None:
    """Throw away what comes until nothing comes any more, or somebody never stops."""
    end_s = clock.now() + 4.0 * HELD_S
    while port.read(_AT_ONCE, min(clock.now() + HELD_S, end_s)) and clock.now() < end_s:
        pass
