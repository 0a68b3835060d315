"""Indirect addresses of the X series: bytes from all over the RAM, side by side in data cells.

From the e-manual (page text "Indirect Address, Indirect Data" and the tables of the models' pages): cell n
stands for the byte that address n names, at first for itself, and it holds 0; only RAM can be named (64 to
the last cell), another address is out of range; a cell has the size, range and access of what it stands for;
they are RAM, so power-off and reboot forget them (also ROBOTIS in DynamixelSDK issue 375). Torque locks the
EEPROM (page text "Torque Enable"), and so none of this.
XL330 and XC330 have 20 cells at 208 "prior to V53", then 28 at 224 (note under the table of the XL330's page; the
SDK's ``..._fw52.model`` beside ``xl330_m288.model``). Assumed:
- an address of an indirect address may be named too: it lies between 64 and the last cell;
- a cell that names a cell stands for that cell's own byte, not for what the other names;
- a register is written through its cells if all its bytes come in order, else it is refused.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from drivers.servos import x
from drivers.servos.register import Register, ServoModel


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


LONG: Final = (Window(168, 224, 28), Window(578, 634, 28))
MIDDLE: Final = LONG[:1]
SHORT: Final = (Window(168, 208, 20),)
_LAST_SHORT: Final = 52


def windows_of(model: ServoModel, firmware: int) -> tuple[Window, ...]:
    """What a servo with this firmware version has."""
    if model not in x.X330:
        return LONG
    return SHORT if firmware <= _LAST_SHORT else MIDDLE


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
