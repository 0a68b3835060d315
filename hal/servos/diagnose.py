"""Why a servo does not answer as it should, in words: asked when set-up fails, never in a cycle.

Nothing is written to any servo: only states are read, at other baud rates too.
"""

from collections.abc import Sequence
from typing import Final

from drivers.bus.bus import Bus
from drivers.bus.types import FaultKind, Reading, ServoFault
from drivers.errors import PortError, PortLost
from drivers.port.latency import HELD_BACK, latency_advice
from drivers.port.owners import line_advice

BAUD_RATES: Final = (
    *(1_000_000, 57_600, 115_200, 500_000, 2_000_000, 3_000_000, 4_000_000),
    *(250_000, 128_000, 76_800, 38_400, 9_600),
    *(400_000, 200_000, 19_200, 2_250_000, 2_500_000, 4_500_000),
)
"""What servos are delivered with or can be set to by their tables, the likely ones first."""
TRIES: Final = 4
MORE_TRIES: Final = 12
"""Where none of those gave a present answer. Together they last about as long as a reply may be held back
(drivers.bus.late_replies.HELD_S)."""
NOWHERE: Final = "does not answer at any baud rate"


def diagnose(bus: Bus, servo_ids: Sequence[int]) -> dict[int, str]:
    """For each servo that did not give its state in ``TRIES`` tries: what is likely wrong with it.

    Told apart are a servo at another baud rate, two servos with one ID, a bad line, an adapter that holds
    replies back, and an absent servo. The port has its former baud rate afterwards. Raises PortLost once the
    line is gone.
    """
    texts = _judged(bus, servo_ids)
    silent = [i for i, text in texts.items() if NOWHERE in text]
    texts |= {i: f"servo {i}: answers at {baud} baud: {_REMEDY}" for i, baud in _elsewhere(bus, silent).items()}
    return texts


def diagnose_known(bus: Bus, servo_ids: Sequence[int]) -> dict[int, str]:
    """``diagnose`` for servos that have answered at this rate before: no other rates, and no word of silent ones.

    Another component of the robot may have to wait meanwhile: this takes half a second, not several.
    """
    return {i: text for i, text in _judged(bus, servo_ids).items() if NOWHERE not in text}


def now_and_then(servo_id: int, device: str) -> str:
    """What to say of a servo that did not answer, where ``diagnose`` finds nothing wrong."""
    advice = line_advice(device, "the cable's plugs, the supply and the adapter")
    return f"servo {servo_id}: answers only now and then: the line is bad: check {advice}"


_REMEDY: Final = "set the servo to the bus's baud rate, or correct baud in the robot file"


_REFUSES: Final = "is it of the model in the robot file, and its firmware whole?"


def _kind(reading: Reading) -> FaultKind | None:
    return reading.kind if isinstance(reading, ServoFault) else None


def _judged(bus: Bus, servo_ids: Sequence[int]) -> dict[int, str]:
    """What the tries at the bus's own rate say of each that never gave its state, or only too late."""
    # A reply that comes while another servo is asked is no reading of its own servo, but it is counted.
    late_before = {i: bus.counters.of(i).late for i in servo_ids}
    tries = [bus.read_states(servo_ids) for _ in range(TRIES)]
    kinds = {i: [_kind(reading[i]) for reading in tries] for i in servo_ids}
    said = [(i, reading[i]) for reading in tries for i in servo_ids]
    refusals = {i: what.text for i, what in said if isinstance(what, ServoFault) and what.kind == "refused"}
    unclear = [i for i in servo_ids if set(kinds[i]) <= {"silent", "late"}]
    for _ in range(MORE_TRIES if unclear else 0):
        for i, reading in bus.read_states(unclear).items():
            kinds[i].append(_kind(reading))
    advice = latency_advice(bus.name) or HELD_BACK
    texts: dict[int, str] = {}
    for i in servo_ids:
        # The first that comes after a long silence counts as late, for it may be; of a line that loses half of them
        # there are several such, and more that come in time between them.
        # The more late replies, the more of them collide with others' or pass for present ones: the first tries count.
        late = bus.counters.of(i).late - late_before[i]
        if late > 1 + kinds[i].count(None) and not {None, "corrupt"} & set(kinds[i][:TRIES]):
            texts[i] = f"servo {i}: answers too late: {advice}"
        elif None not in kinds[i]:
            texts[i] = f"{refusals[i]}: {_REFUSES}" if i in refusals else _judge(i, kinds[i], bus.name)
    return texts


def _judge(servo_id: int, kinds: Sequence[FaultKind | None], device: str) -> str:
    """Two servos with one ID answer at the same moment, and what arrives is a mixture: every time."""
    if "reset" in kinds:
        return f"servo {servo_id}: loses its memory again and again, as in a reboot: check its supply"
    if "silent" not in kinds:
        return (
            f"servo {servo_id}: answers, but never in one piece: do two servos have ID {servo_id}? "
            f"Unplug one and give it another ID. If there is only one, check {line_advice(device)}"
        )
    if set(kinds) == {"silent"}:
        return f"servo {servo_id}: {NOWHERE}: check its power, its cable and its ID"
    advice = line_advice(device, "the cable's plugs and the supply")
    return f"servo {servo_id}: answers now and then, and broken: check {advice}"


def _elsewhere(bus: Bus, servo_ids: Sequence[int]) -> dict[int, int]:
    """Baud rates at which the missing ones answer after all."""
    found: dict[int, int] = {}
    for baud in BAUD_RATES:
        missing = [i for i in servo_ids if i not in found]
        if baud != bus.baud:
            # Twice: the first that is heard at a rate may be an answer to a question at the one before.
            heard = _heard_at(bus, baud, missing)
            found |= dict.fromkeys(_heard_at(bus, baud, heard), baud)
    return found


def _heard_at(bus: Bus, baud: int, servo_ids: Sequence[int]) -> list[int]:
    """Who gives a state at this rate."""
    if not servo_ids:
        return []
    try:
        with bus.at_baud(baud) as other:
            readings = other.read_states(servo_ids)
    except PortLost:
        raise
    except PortError:  # the adapter does not know this rate
        return []
    return [i for i, reading in readings.items() if not isinstance(reading, ServoFault)]
