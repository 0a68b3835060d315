"""Indirect addresses of the X series: bytes from all over the RAM, side by side in data cells.

From the e-manual: cell n stands for the byte that address n names, at first for itself; only RAM can be
named; a cell has the size, range and access of what it stands for; they are RAM, so power-off forgets
them. The manual locks nothing of it under torque. Assumed:
- a cell that names a cell stands for that cell's own byte, not for what the other names;
- a register is written through its cells if all its bytes come in order, else it is refused;
- XL330 and XC330 have the table of the firmware up to 52; the e-manual's newer one has the data at 224.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from drivers.dynamixel import x_series as x
from drivers.registers import Register


@dataclass(frozen=True, slots=True)
class Window:
    """Some indirect addresses, and the data cells that belong to them."""

    addresses: int
    data: int
    count: int

    def covers(self, address: int) -> bool:
        """Whether this is one of the data cells."""
        return self.data <= address < self.data + self.count

    def pointer(self, cell: int) -> int:
        """Where the address of the data cell at ``cell`` stands."""
        return self.addresses + 2 * (cell - self.data)


_LONG: Final = (Window(168, 224, 28), Window(578, 634, 28))
_SHORT: Final = (Window(168, 208, 20),)
WINDOWS: Final[dict[str, tuple[Window, ...]]] = {
    x.XL330_M077.name: _SHORT,
    x.XL330_M288.name: _SHORT,
    x.XC330_M181.name: _SHORT,
    x.XC330_M288.name: _SHORT,
    x.XC330_T181.name: _SHORT,
    x.XC330_T288.name: _SHORT,
    x.XL430_W250.name: _LONG,
    x.XC430_W150.name: _LONG,
    x.XC430_W240.name: _LONG,
    x.XM430_W210.name: _LONG,
    x.XM430_W350.name: _LONG,
    x.MX_28_2.name: _LONG,
}
"""By model name."""


def pointers(windows: Sequence[Window]) -> Iterator[tuple[Register, int]]:
    """All indirect addresses with what they hold after power-on."""
    number = 0
    for window in windows:
        for i in range(window.count):
            number += 1
            yield Register(f"indirect_address_{number}", window.addresses + 2 * i, 2), window.data + i


def cells(windows: Sequence[Window]) -> Iterator[Register]:
    """All data cells."""
    places = [window.data + i for window in windows for i in range(window.count)]
    for number, address in enumerate(places, 1):
        yield Register(f"indirect_data_{number}", address, 1)


def resolved(windows: Sequence[Window], table: bytes | bytearray, address: int, size: int) -> list[int]:
    """Which bytes of the ``table`` are meant by ``size`` bytes from ``address``."""
    meant = list(range(address, address + size))
    for i, place in enumerate(meant):
        for window in windows:
            if window.covers(place):
                at = window.pointer(place)
                meant[i] = int.from_bytes(table[at : at + 2], "little")
                break
    return meant


def runs(places: Sequence[int]) -> Iterator[tuple[int, int]]:
    """Where bytes follow one another: each time from which of them to before which."""
    begin = 0
    for i in range(1, len(places) + 1):
        if i == len(places) or places[i] != places[i - 1] + 1:
            yield begin, i
            begin = i
