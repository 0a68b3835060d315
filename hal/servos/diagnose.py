"""Find the likely cause of a servo's communication fault. Call this only after a failed setup, and never in a control
cycle.

The diagnosis reads states, also at other baud rates, but does not write to the servos.
"""

from collections.abc import Sequence
from typing import Final

from drivers.bus.bus import Bus
from drivers.bus.retry import ATTEMPTS
from drivers.driver_errors import PortError, PortLost
from drivers.port.latency import HELD_BACK, latency_advice
from drivers.port.owners import line_advice
from drivers.types import FaultKind, Reading, ServoFault

BAUD_RATES: Final = (
    *(1_000_000, 57_600, 115_200, 500_000, 2_000_000, 3_000_000, 4_000_000),
    *(250_000, 128_000, 76_800, 38_400, 9_600),
    *(400_000, 200_000, 19_200, 2_250_000, 2_500_000, 4_500_000),
)
"""Baud rates from the servos' control tables, with the most likely rates first."""
TRIES: Final = 4
"""Number of times each servo is read."""
MORE_TRIES: Final = 12
"""Number of additional reads if a servo did not reply in time. Together, these reads take about as long as an adapter
may delay a reply (drivers.bus.late_replies.HELD_S).
"""
NO_BAUD_RATE: Final = "does not respond at any baud rate"


def diagnose(bus: Bus, servo_ids: Sequence[int]) -> dict[int, str]:
    """Find the likely cause for each servo that did not report its state in ``TRIES`` reads.

    The diagnosis distinguishes between a servo at a different baud rate, two servos with the same ID, a bad connection,
    an adapter that delays replies, and a missing servo. The baud rate of the port is restored afterward.

    Args:
        bus: The bus.
        servo_ids: IDs of the servos.

    Returns:
        Descriptions, keyed by servo ID.

    Raises:
        PortLost: The port is lost.
    """
    texts = _diagnosed(bus, servo_ids)
    silent = [i for i, text in texts.items() if NO_BAUD_RATE in text]
    texts |= {i: f"servo {i}: responds at {baud} baud: {_REMEDY}" for i, baud in _found_at(bus, silent).items()}
    return texts


def diagnose_known(bus: Bus, servo_ids: Sequence[int]) -> dict[int, str]:
    """Diagnose servos that have already responded at this baud rate.

    Other baud rates are not tried, and servos that do not respond at all are omitted. This takes half a second instead
    of several seconds, because other components may have to wait for the diagnosis.
    """
    return {i: text for i, text in _diagnosed(bus, servo_ids).items() if NO_BAUD_RATE not in text}


def read_explained_states(bus: Bus, servo_ids: Sequence[int]) -> tuple[dict[int, Reading], dict[int, str]]:
    """Read the states of servos.

    Return the states, and the likely causes for missing states if they were found. A silent servo is read again after
    the diagnosis, which takes half a second.
    """
    found = _read_states(bus, servo_ids)
    missing = {i: reading for i, reading in found.items() if isinstance(reading, ServoFault)}
    if not missing:
        return found, {}
    causes = diagnose_known(bus, tuple(missing))
    silent = [i for i, fault in missing.items() if fault.kind == "silent" and i not in causes]
    return found | (_read_states(bus, silent) if silent else {}), causes


def _read_states(bus: Bus, servo_ids: Sequence[int]) -> dict[int, Reading]:
    """Read the states of servos. Servos that did not report a state are read again."""
    found: dict[int, Reading] = {}
    missing = list(servo_ids)
    for _ in range(ATTEMPTS):
        found |= bus.read_states(missing)
        missing = [i for i, reading in found.items() if isinstance(reading, ServoFault)]
        if not missing:
            break
    return found


def intermittent_text(servo_id: int, device: str) -> str:
    """Return the message about a servo that did not respond although ``diagnose`` finds no cause."""
    advice = line_advice(device, "the cable's plugs, the supply and the adapter")
    return f"servo {servo_id}: responds only intermittently: check {advice}"


_REMEDY: Final = "set the servo to the bus's baud rate, or correct baud in the robot file"


_REFUSES: Final = "check its model in the robot file and its firmware"


def _kind(reading: Reading) -> FaultKind | None:
    return reading.kind if isinstance(reading, ServoFault) else None


def _diagnosed(bus: Bus, servo_ids: Sequence[int]) -> dict[int, str]:
    """Describe each servo that never reported its state, or reported it too late, at the bus's own baud rate."""
    # A reply that arrives while another servo is being asked is counted as a late reply, not as a reading.
    late_before = {i: bus.counters.of(i).late for i in servo_ids}
    tries = [bus.read_states(servo_ids) for _ in range(TRIES)]
    kinds = {i: [_kind(reading[i]) for reading in tries] for i in servo_ids}
    found = [(i, reading[i]) for reading in tries for i in servo_ids]
    refusals = {i: fault.text for i, fault in found if isinstance(fault, ServoFault) and fault.kind == "refused"}
    unclear = [i for i in servo_ids if set(kinds[i]) <= {"silent", "late"}]
    for _ in range(MORE_TRIES if unclear else 0):
        for i, reading in bus.read_states(unclear).items():
            kinds[i].append(_kind(reading))
    advice = latency_advice(bus.name) or HELD_BACK
    texts: dict[int, str] = {}
    for i in servo_ids:
        # The first reply after a long silence is counted as late, because it may answer an earlier request. A
        # connection that loses half of the replies causes several late replies, but even more timely ones. Late
        # replies also collide with other replies or are mistaken for timely ones, so only the first attempts must
        # contain neither timely nor corrupt replies.
        late = bus.counters.of(i).late - late_before[i]
        if late > 1 + kinds[i].count(None) and not {None, "corrupt"} & set(kinds[i][:TRIES]):
            texts[i] = f"servo {i}: responds too late: {advice}"
        elif None not in kinds[i]:
            texts[i] = f"{refusals[i]}: {_REFUSES}" if i in refusals else _cause(i, kinds[i], bus.name)
    return texts


def _cause(servo_id: int, kinds: Sequence[FaultKind | None], device: str) -> str:
    if "reset" in kinds:
        return f"servo {servo_id}: restarts repeatedly: check its supply"
    if "silent" not in kinds:  # two servos with the same ID reply simultaneously, so every reply is corrupt
        return (
            f"servo {servo_id}: responds, but every reply is corrupted: do two servos have ID {servo_id}? "
            f"Unplug one and give it another ID. If there is only one, check {line_advice(device)}"
        )
    if set(kinds) == {"silent"}:
        return f"servo {servo_id}: {NO_BAUD_RATE}: check its power, its cable and its ID"
    advice = line_advice(device, "the cable's plugs and the supply")
    return f"servo {servo_id}: responds only intermittently, with corrupted replies: check {advice}"


def _found_at(bus: Bus, servo_ids: Sequence[int]) -> dict[int, int]:
    """Return the baud rate at which each missing servo responds, keyed by servo ID."""
    found: dict[int, int] = {}
    for baud in BAUD_RATES:
        missing = [i for i in servo_ids if i not in found]
        if baud != bus.baud:
            # Read twice, because the first reply at a baud rate may answer a request sent at the previous baud rate.
            answering = _answering_at(bus, baud, missing)
            found |= dict.fromkeys(_answering_at(bus, baud, answering), baud)
    return found


def _answering_at(bus: Bus, baud: int, servo_ids: Sequence[int]) -> list[int]:
    """Return the IDs of the servos that report a state at this baud rate."""
    if not servo_ids:
        return []
    try:
        with bus.at_baud(baud) as other:
            readings = other.read_states(servo_ids)
    except PortLost:
        raise
    except PortError:  # the adapter does not support this baud rate
        return []
    return [i for i, reading in readings.items() if not isinstance(reading, ServoFault)]
