"""Models of protocol 1.0 that are simulated but not driven. Their motors were identified on hardware.

Source: e-manual. Their tables have more registers than the MX-28's, for current and torque mode, which are left out.
"""

from dataclasses import replace
from math import pi
from typing import Final

from drivers.servos.ax_mx import MX_28

_RPM: Final = 2.0 * pi / 60.0

MX_64: Final = replace(
    MX_28, name="mx-64", number=310, stall_torque_nm=6.0, no_load_speed_rad_s=63.0 * _RPM, stall_current_a=4.1
)
MX_106: Final = replace(
    MX_28, name="mx-106", number=320, stall_torque_nm=8.4, no_load_speed_rad_s=45.0 * _RPM, stall_current_a=5.2
)
