"""A servo's whole control table, read in a few blocks."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Final

from drivers.bus.bus import Bus
from drivers.bus.retry import retry
from drivers.errors import ServoError
from drivers.servos.register import Access, ByteOrder, Register
from drivers.servos.series import Series

LARGEST_BLOCK: Final = 60
LARGEST_GAP: Final = 8
"""Bytes that no table names; servos answer them too."""


def read_table(bus: Bus, servo_id: int, series: Series) -> Mapping[str, int]:
    """Every register by name, as far as it can be read. Raises PortLost once the line is gone."""
    values: dict[str, int] = {}
    for block in blocks(series.registers):
        values |= _read_block(bus, servo_id, block, series.protocol.byte_order)
    return values


def blocks(registers: Sequence[Register]) -> Iterator[tuple[Register, ...]]:
    """The registers (by address) in runs that one read can fetch."""
    run: list[Register] = []
    for register in registers:
        end = run[-1].address + run[-1].size if run else 0
        too_long = run and register.address + register.size - run[0].address > LARGEST_BLOCK
        if run and (register.address - end > LARGEST_GAP or too_long):
            yield tuple(run)
            run = []
        run.append(register)
    if run:
        yield tuple(run)


def _read_block(bus: Bus, servo_id: int, block: Sequence[Register], order: ByteOrder) -> Mapping[str, int]:
    start = block[0].address
    size = max(register.address + register.size for register in block) - start
    try:
        whole = retry(partial(bus.read, servo_id, Register("block", start, size, Access.READ)))
    except ServoError:
        return _one_by_one(bus, servo_id, block) if len(block) > 1 else {}
    data = whole.to_bytes(size, order)
    return {
        register.name: register.decode(data[register.address - start :][: register.size], order) for register in block
    }


def _one_by_one(bus: Bus, servo_id: int, block: Sequence[Register]) -> Mapping[str, int]:
    """A servo with an older table may not answer beyond its end; what lies before that is still wanted."""
    values: dict[str, int] = {}
    for register in block:
        try:
            values[register.name] = retry(partial(bus.read, servo_id, register))
        except ServoError:
            if not values:
                break  # the first failed too: it is the servo that does not answer
    return values
