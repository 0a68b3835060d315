"""Confirm positions by two consecutive readings that agree, because corrupt data can have a valid checksum."""

from collections.abc import Callable, Mapping, Sequence
from typing import Final

from drivers.types import Reading, ServoFault, ServoState

READINGS: Final = 8
"""Maximum number of readings."""
AGREE_COUNTS: Final = 16
"""Largest difference between readings that agree, in counts. The readings of servos that are at rest, or slowly turned
by hand, differ by less.
"""


def confirmed_states(
    read: Callable[[Sequence[int]], Mapping[int, Reading]], servo_ids: Sequence[int]
) -> dict[int, Reading]:
    """Read states until two consecutive readings of each servo agree on its position.

    Args:
        read: Function that returns the states of servos, keyed by ID, such as ``Bus.read_states``.
        servo_ids: IDs of the servos.

    Returns:
        The latest state of each servo, or a fault if it did not respond or its readings never agreed.
    """
    last: dict[int, Reading] = dict(read(servo_ids))
    found: dict[int, Reading] = {}
    for _ in range(READINGS - 1):
        missing = [servo_id for servo_id in servo_ids if servo_id not in found]
        if not missing:
            return found
        before, last = last, dict(read(missing))
        found |= {servo_id: last[servo_id] for servo_id in missing if _agree(before[servo_id], last[servo_id])}
    return {i: found[i] if i in found else _unconfirmed(i, last[i]) for i in servo_ids}


def _agree(one: Reading, other: Reading) -> bool:
    if not isinstance(one, ServoState) or not isinstance(other, ServoState):
        return False
    return abs(one.position_counts - other.position_counts) <= AGREE_COUNTS


def _unconfirmed(servo_id: int, reading: Reading) -> Reading:
    if isinstance(reading, ServoState):
        return ServoFault("corrupt", f"servo {servo_id} reports a different position in every reading")
    return reading
