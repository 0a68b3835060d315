"""Differences between the firmware versions of Dynamixel X servos, as far as the driver uses them.

Source: ROBOTIS e-manual, "Fast Sync Read", and the release notes on the models' pages. The version is in register 6.
- Fast sync read since version 45 or 46, depending on the model.
- XL330 and XC330 have other indirect registers since version 53 (drivers/servos/indirect.py).
- Since version 42 a factory reset that is sent to all IDs is ignored. The driver sends it to single IDs only.
"""

from typing import Final

from drivers.servos import x
from drivers.servos.register import ServoModel

_X330_SINCE: Final = 46
_FAST_READ_SINCE: Final = {
    name: _X330_SINCE for name, model in x.MODELS.items() if x.has_short_map(model)
} | dict.fromkeys((model.name for model in (x.XL430_W250, x.XC430_W150, x.XC430_W240, x.XM430_W210, x.XM430_W350)), 45)
"""First firmware version with fast sync reads, for the models in the e-manual's list."""


def reads_fast(model: ServoModel, version: int | None) -> bool | None:
    """Return whether a servo supports fast sync reads.

    Args:
        model: Model of the servo.
        version: Firmware version that it reports; None if it was not read.

    Returns:
        Whether it supports them; None if this is unknown, so that only a trial can show it.
    """
    since = _FAST_READ_SINCE.get(model.name)
    return None if since is None or version is None else version >= since
