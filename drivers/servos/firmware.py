"""Differences between firmware versions of Dynamixel X servos that affect the driver.

Source: ROBOTIS e-manual, "Fast Sync Read", and the release notes on the models' pages. The version is stored in
register 6.
- Fast sync read is supported since version 45 or 46, depending on the model.
- Since version 53, XL330 and XC330 have different indirect registers (drivers/servos/indirect.py).
- Since version 42 a factory reset that is sent to all IDs is ignored. The driver sends factory resets only to single
  IDs.
"""

from typing import Final

from drivers.servos import x
from drivers.servos.register import ServoModel

_FAST_READ_SINCE: Final = 45
_FAST_READ_SINCE_X330: Final = 46
"""First firmware version of XL330, XC330 and XC335 that supports fast sync reads."""


def _fast_read_since(model: ServoModel) -> int | None:
    if not isinstance(model, x.XModel) or x.acceleration_limit in model.own:  # an MX is not in the e-manual's list
        return None
    return _FAST_READ_SINCE_X330 if x.pwm_slope in model.own else _FAST_READ_SINCE


def reads_fast(model: ServoModel, version: int | None) -> bool | None:
    """Return whether a servo supports fast sync reads.

    Args:
        model: Model of the servo.
        version: Firmware version that the servo reports; None if it was not read.

    Returns:
        Whether the servo supports fast sync reads, or None if only a trial can determine this.
    """
    since = _fast_read_since(model)
    return None if since is None or version is None else version >= since
