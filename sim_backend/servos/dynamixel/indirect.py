"""Indirect addresses of the X series: adjacent data registers that mirror bytes anywhere in RAM.

From the e-manual (page text "Indirect Address, Indirect Data" and the tables of the models' pages):
- Data register n mirrors the byte at the address stored in indirect address n. Initially, each indirect address
  contains the address of its own data register, which contains 0.
- Only RAM can be mirrored (from 64 to the last data register). An address outside this range is rejected.
- A data register has the size, range and access of the byte that it mirrors.
- The addresses are in RAM, so power-off and reboot reset them (confirmed by ROBOTIS in DynamixelSDK issue 375).
- When torque is enabled, only the EEPROM is locked (page text "Torque Enable"), so all indirect registers stay
  writable.
- XL330 and XC330 have 20 data registers at 208 "prior to V53", and 28 data registers at 224 from that version on. The
  sources are the note under the table of the XL330's page, and the SDK's ``..._fw52.model`` in addition to
  ``xl330_m288.model``.

Assumed:
- An indirect address may contain the address of an indirect address, because that address is between 64 and the last
  data register.
- If a data register mirrors another data register, it contains the other register's own byte, not the byte that the
  other register mirrors.
- A register can be written through data registers if they mirror all its bytes in order. Otherwise, the write is
  rejected.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from struct import unpack_from
from typing import Final

from drivers.servos import x
from drivers.servos.register import Register, ServoModel, between


@dataclass(frozen=True, slots=True)
class Window:
    """A block of indirect addresses and their data registers."""

    addresses: int
    data: int
    count: int

    def pointer(self, cell: int) -> int:
        """Return the address of the indirect address that belongs to the data register at ``cell``."""
        return self.addresses + 2 * (cell - self.data)


LONG: Final = (Window(168, 224, 28), Window(578, 634, 28))
MIDDLE: Final = LONG[:1]
SHORT: Final = (Window(168, 208, 20),)
_LAST_SHORT: Final = 52


def windows_of(model: ServoModel, firmware: int) -> tuple[Window, ...]:
    """Return the blocks of indirect registers for this model and firmware version."""
    if x.has_short_map(model) and firmware <= _LAST_SHORT:
        return SHORT
    return MIDDLE if x.pwm_slope in model.own else LONG


def pointers(windows: Sequence[Window]) -> Iterator[tuple[Register, int]]:
    """Yield all indirect addresses with their values after power-on."""
    number, shown = 0, between(x.torque_enable.address, max(window.data + window.count for window in windows) - 1)
    for window in windows:
        for i in range(window.count):
            number += 1
            yield Register(f"indirect_address_{number}", window.addresses + 2 * i, 2, values=shown), window.data + i


def cells(windows: Sequence[Window]) -> Iterator[Register]:
    """Yield all data registers."""
    places = [window.data + i for window in windows for i in range(window.count)]
    for number, address in enumerate(places, 1):
        yield Register(f"indirect_data_{number}", address, 1)


def resolved(windows: Sequence[Window], table: bytes | bytearray, address: int, size: int) -> list[int]:
    """Return the indices in ``table`` of the bytes that a read or write of ``size`` bytes at ``address`` refers to."""
    end = address + size
    meant = list(range(address, end))
    for window in windows:
        first, last = max(address, window.data), min(end, window.data + window.count)
        if first < last:
            meant[first - address : last - address] = unpack_from(f"<{last - first}H", table, window.pointer(first))
    return meant
