"""Why a servo does not answer as it should, in words: asked when set-up fails, never in a cycle.

Nothing is written to any servo: only states are read, at other baud rates too.
"""

from collections.abc import Sequence
from typing import Final

from drivers.bus import FaultKind, Reading, ServoBus, ServoFault
from drivers.errors import PortError

BAUD_RATES: Final = (
    *(1_000_000, 57_600, 115_200, 500_000, 2_000_000, 3_000_000, 4_000_000),
    *(250_000, 128_000, 76_800, 38_400, 9_600),
)
"""What servos are delivered with or set to, the likely ones first."""
TRIES: Final = 4
NOWHERE: Final = "does not answer at any baud rate"


def diagnose(bus: ServoBus, servo_ids: Sequence[int]) -> dict[int, str]:
    """For each servo that did not give its state in ``TRIES`` tries: what is likely wrong with it.

    Told apart are a servo at another baud rate, two servos with one ID, a bad line, and an absent one.
    The port has its former baud rate afterwards. Raises PortLost once the line is gone.
    """
    tries = [bus.read_states(servo_ids) for _ in range(TRIES)]
    faults = {i: kinds for i in servo_ids if (kinds := [_kind(reading[i]) for reading in tries])}
    texts = {i: _judge(i, kinds) for i, kinds in faults.items() if None not in kinds}
    silent = [i for i in texts if set(faults[i]) == {"silent"}]
    texts |= {i: f"servo {i}: answers at {baud} baud: {_REMEDY}" for i, baud in _elsewhere(bus, silent).items()}
    return texts


_REMEDY: Final = "set the servo to the bus's baud rate, or correct baud in the robot file"


def _kind(reading: Reading) -> FaultKind | None:
    return reading.kind if isinstance(reading, ServoFault) else None


def _judge(servo_id: int, kinds: Sequence[FaultKind | None]) -> str:
    """Two servos with one ID answer at the same moment, and what arrives is a mixture: every time."""
    if "silent" not in kinds:
        return (
            f"servo {servo_id}: answers, but never in one piece: do two servos have ID {servo_id}? "
            "Unplug one and give it another ID. If there is only one, check the cable's plugs"
        )
    if set(kinds) == {"silent"}:
        return f"servo {servo_id}: {NOWHERE}: check its power, its cable and its ID"
    return f"servo {servo_id}: answers now and then, and broken: check the cable's plugs and the supply"


def _elsewhere(bus: ServoBus, servo_ids: Sequence[int]) -> dict[int, int]:
    """Baud rates at which the missing ones answer after all."""
    found: dict[int, int] = {}
    for baud in BAUD_RATES:
        missing = [i for i in servo_ids if i not in found]
        if not missing:
            break
        try:
            with bus.at_baud(baud) as other:
                readings = other.read_states(missing)
        except PortError:  # the adapter does not know this rate
            continue
        found |= {i: baud for i, reading in readings.items() if not isinstance(reading, ServoFault)}
    return found
