"""USB chips of serial adapters for servos, by vendor and product ID.

Sources: the ID tables of the Linux drivers ch341, cp210x, ftdi_sio and cdc_acm; for boards, the udev rules of their
manufacturers and listings published by users. An ID identifies the chip, but does not always identify the board.
"""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class Chip:
    """A USB chip."""

    name: str
    driver: str
    """Kernel module."""
    found_on: str = ""
    """Servo boards that are known to use this chip."""


CHIPS: Final = {
    (0x1A86, 0x7523): Chip("CH340", "ch341", "Feetech and Waveshare adapters, older SO-100 kits"),
    (0x1A86, 0x7522): Chip("CH340K", "ch341"),
    (0x1A86, 0x5523): Chip("CH341", "ch341"),
    (0x1A86, 0x55D2): Chip("CH342", "cdc_acm"),
    (0x1A86, 0x55D3): Chip("CH343", "cdc_acm", "Waveshare Bus Servo Adapter (A), SO-101 kits"),
    (0x1A86, 0x55D4): Chip("CH9102", "cdc_acm"),
    (0x10C4, 0xEA60): Chip("CP2102", "cp210x", "Waveshare Servo Driver with ESP32"),
    (0x0403, 0x6001): Chip("FTDI FT232R", "ftdi_sio"),
    (0x0403, 0x6010): Chip("FTDI FT2232", "ftdi_sio"),
    (0x0403, 0x6011): Chip("FTDI FT4232", "ftdi_sio"),
    (0x0403, 0x6014): Chip("FTDI FT232H", "ftdi_sio", "ROBOTIS U2D2"),
    (0x0403, 0x6015): Chip("FTDI FT-X", "ftdi_sio"),
    (0x2F5D, 0x2202): Chip("SAMD21", "cdc_acm", "ROBOTIS OpenRB-150"),
    (0x0483, 0x5740): Chip("ST virtual COM port", "cdc_acm", "ROBOTIS OpenCR, boards with an STM32"),
}


def chip_text(vid: int, pid: int) -> str:
    """Return a name for an adapter with these IDs."""
    chip = CHIPS.get((vid, pid))
    if chip is None:
        return "unknown chip"
    return f"{chip.name} ({chip.found_on})" if chip.found_on else chip.name
