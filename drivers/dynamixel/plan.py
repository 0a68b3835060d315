"""What is asked of which servos in one transaction, and how their replies lie one behind the other."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import groupby

from drivers.bus import ServoState
from drivers.dynamixel import state, wire
from drivers.dynamixel.series import StateBlock
from drivers.dynamixel.servos import Servos
from drivers.readings import Outcome

_Run = tuple[tuple[int, ...], StateBlock, tuple[float | None, ...], int]
"""Servos asked for one block that answer one after the other: IDs, block, units of current, bytes of all replies."""


@dataclass(frozen=True, slots=True)
class Plan:
    """One question for states. ``sizes`` are the data of each servo's reply, in the order of the question."""

    servo_ids: tuple[int, ...]
    blocks: Mapping[int, StateBlock]
    sizes: Mapping[int, int]
    units_a: Mapping[int, float | None]
    """What one unit of each servo's current is; None for one that measures none."""
    request: bytes
    reply_size: int
    """Bytes of all replies, where nothing is stuffed."""
    runs: tuple[_Run, ...]
    fast: bool = False
    """Whether they answer with one packet."""

    def states(self, data: bytes) -> Mapping[int, ServoState] | None:
        """All states where ``data`` is exactly the replies of all servos in their order; None otherwise."""
        if len(self.runs) == 1:
            servo_ids, block, units_a, _ = self.runs[0]
            return (state.fast_whole if self.fast else state.burst)(data, servo_ids, block, units_a)
        if len(data) != self.reply_size:
            return None
        states: dict[int, ServoState] = {}
        at = 0
        for servo_ids, block, units_a, length in self.runs:
            part = state.burst(data[at : at + length], servo_ids, block, units_a)
            if part is None:
                return None
            states.update(part)
            at += length
        return states

    def fast_outcome(self, data: bytes) -> dict[int, Outcome]:
        """What the servos say in one packet, up to the first that cannot be believed."""
        servo_ids, block, units_a, _ = self.runs[0]
        return state.fast_outcome(data, servo_ids, block, units_a)

    def bytes_from(self, servo_ids: tuple[int, ...]) -> int:
        """Bytes of these servos' replies."""
        return sum(self.sizes[i] + wire.OVERHEAD for i in servo_ids)


def plan_for(blocks: Mapping[int, StateBlock], units_a: Mapping[int, float | None]) -> Plan:
    """Ask each servo for its block: by a sync read where they lie alike in all, else by a bulk read."""
    servo_ids = tuple(blocks)
    spans = {i: (block.address, block.size) for i, block in blocks.items()}
    if len(set(spans.values())) == 1:
        request = wire.sync_read(servo_ids, *spans[servo_ids[0]])
    else:
        request = wire.bulk_read(spans)
    runs: list[_Run] = []
    for block, group in groupby(servo_ids, key=lambda i: blocks[i]):
        ids = tuple(group)
        runs.append((ids, block, tuple(units_a[i] for i in ids), (block.size + wire.OVERHEAD) * len(ids)))
    reply_size = sum(length for *_, length in runs)
    sizes = {i: size for i, (_, size) in spans.items()}
    return Plan(servo_ids, blocks, sizes, units_a, request, reply_size, tuple(runs))


def fast_plan_for(units_a: Mapping[int, float | None], block: StateBlock) -> Plan:
    """Ask them for the block by a fast sync read."""
    servo_ids = tuple(units_a)
    reply_size = wire.FAST_HEAD_SIZE + (block.size + wire.FAST_OVERHEAD) * len(servo_ids)
    return Plan(
        servo_ids,
        dict.fromkeys(servo_ids, block),
        dict.fromkeys(servo_ids, block.size),
        units_a,
        wire.fast_sync_read(servo_ids, block.address, block.size),
        reply_size,
        ((servo_ids, block, tuple(units_a.values()), reply_size),),
        fast=True,
    )


class Plans:
    """The plans that are used again and again, as long as the servos are asked for the same."""

    def __init__(self, servos: Servos) -> None:
        self._servos = servos
        self._changes = servos.changes
        self._plain: dict[tuple[tuple[int, ...], int], Plan] = {}
        self._fast: dict[tuple[int, ...], Plan | None] = {}

    def plan(self, servo_ids: tuple[int, ...], place: int = 0) -> Plan:
        """How these servos are asked for their block number ``place``."""
        self._look_for_changes()
        plan = self._plain.get((servo_ids, place))
        if plan is None:
            blocks = {i: self._servos.blocks(i)[place] for i in servo_ids}
            plan = self._plain[servo_ids, place] = plan_for(blocks, self._units_a(servo_ids))
        return plan

    def fast(self, servo_ids: tuple[int, ...]) -> Plan | None:
        """How to ask them by a fast sync read; None where they are not to be asked alike, or may not know it."""
        self._look_for_changes()
        if servo_ids not in self._fast:
            blocks = {self._servos.blocks(i)[0] for i in servo_ids}
            block = blocks.pop() if len(blocks) == 1 else None
            units_a = self._units_a(servo_ids)
            self._fast[servo_ids] = fast_plan_for(units_a, block) if block and block.fast else None
        return self._fast[servo_ids]

    def _units_a(self, servo_ids: tuple[int, ...]) -> dict[int, float | None]:
        return {i: self._servos.current_unit_a(i) for i in servo_ids}

    def _look_for_changes(self) -> None:
        if self._changes != self._servos.changes:
            self._changes = self._servos.changes
            self._plain.clear()
            self._fast.clear()
