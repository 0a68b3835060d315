"""The udev rule for the adapters that are plugged in: who may open them, and how fast they are."""

from collections.abc import Iterable
from typing import TYPE_CHECKING, Final

from commissioning.ports.chips import CHIPS
from commissioning.ports.permission import USUAL_GROUP

if TYPE_CHECKING:
    from commissioning.ports.adapters import Adapter

RULE_FILE: Final = "/etc/udev/rules.d/99-servos.rules"
RELOAD: Final = "sudo udevadm control --reload-rules && sudo udevadm trigger"
FTDI_LATENCY: Final = 'ACTION=="add", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", ATTR{latency_timer}="1"'


def udev_rule(adapters: Iterable["Adapter"]) -> str:
    """Lines for ``RULE_FILE``: one for each adapter on USB, one for the latency timer of FTDI's."""
    known = [one for one in adapters if one.vid is not None and one.pid is not None]
    lines = dict.fromkeys(_line(one) for one in known)
    drivers = {chip.driver for one in known if (chip := CHIPS.get((one.vid or 0, one.pid or 0)))}
    return "\n".join((*lines, *((FTDI_LATENCY,) if "ftdi_sio" in drivers else ())))


def _line(adapter: "Adapter") -> str:
    matches = [
        'SUBSYSTEM=="tty"',
        f'ATTRS{{idVendor}}=="{adapter.vid:04x}"',
        f'ATTRS{{idProduct}}=="{adapter.pid:04x}"',
    ]
    if adapter.serial_number:
        matches.append(f'ATTRS{{serial}}=="{adapter.serial_number}"')
    return ", ".join((*matches, f'GROUP="{USUAL_GROUP}"', 'MODE="0660"', 'ENV{ID_MM_DEVICE_IGNORE}="1"'))
