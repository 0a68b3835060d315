"""The direction of a joint's last motion, from a stream of continuous counts."""

from collections.abc import Iterable


def last_way(counts: Iterable[int], threshold: int) -> int:
    """How far the joint went after it last turned round by more than ``threshold`` counts, with the sign.

    Somebody may first have to go back from a stop to show which way is positive: only the last way counts. 0 where
    there was no motion of more than ``threshold``.
    """
    origin = turning = last = None
    way = 0
    for count in counts:
        if origin is None or turning is None:
            origin = turning = last = count
            continue
        last = count
        if way == 0:
            way = _sign(count - origin) if abs(count - origin) > threshold else 0
            turning = count if way else turning
        elif (count - turning) * way >= 0:
            turning = count
        elif abs(count - turning) > threshold:
            origin, turning, way = turning, count, -way
    return 0 if way == 0 or origin is None or last is None else last - origin


def _sign(value: int) -> int:
    return (value > 0) - (value < 0)
