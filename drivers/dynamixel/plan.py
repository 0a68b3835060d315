"""What is asked of which servos in one transaction, and how their replies lie one behind the other."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import groupby

from drivers.bus import ServoState
from drivers.dynamixel import state, wire
from drivers.dynamixel.models import Series

_Run = tuple[tuple[int, ...], Series, int, int]
"""Servos of one series that answer one after the other: IDs, series, data of a reply, bytes of all."""


@dataclass(frozen=True, slots=True)
class Plan:
    """One question for states. ``sizes`` are the data of each servo's reply, in the order of the question."""

    servo_ids: tuple[int, ...]
    series: Mapping[int, Series]
    sizes: Mapping[int, int]
    request: bytes
    reply_size: int
    """Bytes of all replies, where nothing is stuffed."""
    runs: tuple[_Run, ...]
    fast: bool = False
    """Whether they answer with one packet."""

    def states(self, data: bytes) -> Mapping[int, ServoState] | None:
        """All states where ``data`` is exactly the replies of all servos in their order; None otherwise."""
        if len(self.runs) == 1:
            servo_ids, series, size, _ = self.runs[0]
            decode = state.fast_whole if self.fast else state.burst
            return decode(data, servo_ids, size, series)
        if len(data) != self.reply_size:
            return None
        states: dict[int, ServoState] = {}
        at = 0
        for servo_ids, series, size, length in self.runs:
            part = state.burst(data[at : at + length], servo_ids, size, series)
            if part is None:
                return None
            states.update(part)
            at += length
        return states

    def fast_states(self, data: bytes) -> dict[int, ServoState]:
        """The states in one packet, up to the first servo that cannot be believed."""
        servo_ids, series, size, _ = self.runs[0]
        return state.fast_burst(data, servo_ids, size, series)

    def bytes_from(self, servo_ids: tuple[int, ...]) -> int:
        """Bytes of these servos' replies."""
        return sum(self.sizes[i] + wire.OVERHEAD for i in servo_ids)


def plan_for(servo_ids: tuple[int, ...], series: Mapping[int, Series], place: int) -> Plan:
    """Ask each servo for its series' block number ``place``: by a sync read, or a bulk read where series differ."""
    sizes = {i: series[i].state_sizes[place] for i in servo_ids}
    kinds = {series[i] for i in servo_ids}
    if len(kinds) == 1:
        (kind,) = kinds
        size = kind.state_sizes[place]
        request = wire.sync_read(servo_ids, kind.state_end - size, size)
    else:
        request = wire.bulk_read({i: (series[i].state_end - sizes[i], sizes[i]) for i in servo_ids})
    runs: list[_Run] = []
    for kind, group in groupby(servo_ids, key=lambda i: series[i]):
        ids = tuple(group)
        size = kind.state_sizes[place]
        runs.append((ids, kind, size, (size + wire.OVERHEAD) * len(ids)))
    reply_size = sum(length for *_, length in runs)
    return Plan(servo_ids, {i: series[i] for i in servo_ids}, sizes, request, reply_size, tuple(runs))


def fast_plan_for(servo_ids: tuple[int, ...], series: Series) -> Plan:
    """Ask them for their states by a fast sync read."""
    size = series.state_sizes[0]
    reply_size = wire.FAST_HEAD_SIZE + (size + wire.FAST_OVERHEAD) * len(servo_ids)
    return Plan(
        servo_ids,
        dict.fromkeys(servo_ids, series),
        dict.fromkeys(servo_ids, size),
        wire.fast_sync_read(servo_ids, series.state_end - size, size),
        reply_size,
        ((servo_ids, series, size, reply_size),),
        fast=True,
    )
