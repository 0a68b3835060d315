"""Operating modes by name. Some servos have a register for it, in others the position limits say it."""

from collections.abc import Callable
from typing import Final

from drivers.servos import ax_mx, sts, x, xl320
from drivers.servos.dynamixel import XL, X
from drivers.servos.dynamixel1 import AX_MX
from drivers.servos.feetech import STS
from drivers.servos.register import Register
from drivers.servos.series import Series

MODES: Final[dict[str, tuple[Register, dict[int, str]]]] = {
    STS.name: (sts.operating_mode, {0: "position", 1: "velocity", 2: "PWM", 3: "step"}),
    X.name: (
        x.operating_mode,
        {
            0: "current",
            1: "velocity",
            3: "position",
            4: "extended position",
            5: "current-based position",
            16: "PWM",
        },
    ),
    XL.name: (xl320.control_mode, {1: "wheel", 2: "joint"}),
}
"""By series: where it stands, and what its values are called."""


def mode_text(series: Series, read: Callable[[Register], int]) -> str:
    """The mode that the servo is in."""
    if series.name in MODES:
        register, names = MODES[series.name]
        value = read(register)
        return names.get(value, f"unknown ({value})")
    limits = [read(register) for register in series.position_limits]
    if limits == [0, 0]:
        return "wheel" if series is AX_MX else "motor"
    if series is AX_MX and limits == [ax_mx.MULTI_TURN_LIMIT] * 2:
        return "multi-turn"
    return "position"
