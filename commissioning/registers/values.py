"""Convert register values between raw numbers, quantities with units, and strings."""

import re
from dataclasses import dataclass
from typing import Final

from commissioning.commissioning_errors import CommissioningError
from commissioning.registers.tables import meaning
from drivers.servos import ax_mx, sts, x, xl320
from drivers.servos.catalog import series_of
from drivers.servos.dynamixel import XL, X
from drivers.servos.dynamixel1 import AX_MX
from drivers.servos.feetech import SCS, STS
from drivers.servos.register import Access, Register, ServoModel


@dataclass(frozen=True, slots=True)
class Unit:
    """Unit of a register."""

    symbol: str
    scale: float = 1.0
    """Quantity that corresponds to a raw value of 1."""


COUNTS, COUNTS_S, CELSIUS, PERCENT = (
    Unit("counts"),
    Unit("counts/s"),
    Unit("°C"),
    Unit("%"),
)
DECIVOLT, PER_MILLE, MS = Unit("V", 0.1), Unit("%", 0.1), Unit("ms")
DELAY, ACCELERATION = Unit("µs", 2), Unit("counts/s²", 100)
STS_CURRENT, PWM, PER_1023 = (
    Unit("A", 0.0065),
    Unit("%", 100 / x.FULL_PWM),
    Unit("%", 100 / 1023),
)
X_SPEED, X_ACCELERATION, XL_SPEED = (
    Unit("rpm", 0.229),
    Unit("rev/min²", 214.577),
    Unit("rpm", 0.111),
)
NO_UNIT: Final = Unit("")
_FEETECH: Final = {
    **dict.fromkeys(("min_position", "max_position", "cw_dead_zone", "ccw_dead_zone", "present_position"), COUNTS),
    **dict.fromkeys(("max_temperature", "present_temperature"), CELSIUS),
    **dict.fromkeys(("max_voltage", "min_voltage", "present_voltage"), DECIVOLT),
    **dict.fromkeys(("max_torque", "minimum_startup_force", "present_load"), PER_MILLE),
    **dict.fromkeys(("protective_torque", "overload_torque"), PERCENT),
    **dict.fromkeys(("goal_velocity", "present_velocity"), COUNTS_S),
    "goal_position": COUNTS,
    "return_delay": DELAY,
    "dts": MS,
}
_DYNAMIXEL: Final = {
    **dict.fromkeys(("temperature_limit", "present_temperature"), CELSIUS),
    **dict.fromkeys(("max_voltage_limit", "min_voltage_limit", "present_voltage"), DECIVOLT),
    **dict.fromkeys(("goal_position", "present_position"), COUNTS),
    "return_delay": DELAY,
}
_LIMITED: Final = {
    **_DYNAMIXEL,
    **dict.fromkeys(("cw_angle_limit", "ccw_angle_limit"), COUNTS),
    **dict.fromkeys(("max_torque", "torque_limit", "present_load"), PER_1023),
}
"""Units of the AX series, of MX servos with protocol 1.0, and of the XL-320."""
UNITS: Final[dict[str, dict[str, Unit]]] = {
    STS.name: {
        **_FEETECH,
        **dict.fromkeys(("protection_current", "present_current"), STS_CURRENT),
        **dict.fromkeys(("protection_time", "overcurrent_time"), Unit("ms", 10)),
        **dict.fromkeys(("acceleration", "max_acceleration"), ACCELERATION),
        **dict.fromkeys(("goal_time", "torque_limit"), PER_MILLE),
        **dict.fromkeys(("homing_offset", "present_target"), COUNTS),
        "hts": Unit("ns", 20.83),
        "max_velocity": Unit("rpm", 0.732),
    },
    SCS.name: {
        **_FEETECH,
        **dict.fromkeys(("moving_threshold", "min_velocity", "max_velocity"), Unit("counts/s", 50)),
        "protection_time": Unit("ms", 40),
        "goal_time": MS,
    },
    X.name: {
        **_DYNAMIXEL,
        **dict.fromkeys(("homing_offset", "max_position_limit", "min_position_limit", "position_trajectory"), COUNTS),
        **dict.fromkeys(("moving_threshold", "velocity_limit", "goal_velocity", "profile_velocity"), X_SPEED),
        **dict.fromkeys(("present_velocity", "velocity_trajectory"), X_SPEED),
        **dict.fromkeys(("profile_acceleration", "acceleration_limit"), X_ACCELERATION),
        **dict.fromkeys(("pwm_limit", "goal_pwm", "present_pwm"), PWM),
        "present_load": PER_MILLE,
        "realtime_tick": MS,
        "bus_watchdog": Unit("ms", 20),
    },
    XL.name: {**_LIMITED, **dict.fromkeys(("moving_speed", "present_speed"), XL_SPEED)},
    AX_MX.name: {
        **_LIMITED,
        **dict.fromkeys(("cw_compliance_margin", "ccw_compliance_margin"), COUNTS),
        "realtime_tick": MS,
        "goal_acceleration": Unit("°/s²", 8.583),
    },
}
"""Units, keyed by series and register. Other registers do not have a unit, or have a unit that depends on the model."""


assert xl320.FULL_TORQUE == ax_mx.FULL_TORQUE == 1023 and STS_CURRENT.scale == sts.CURRENT_UNIT_A


def unit_of(model: ServoModel, register: Register) -> Unit:
    """Return the unit of a register. For some registers, the unit depends on the model."""
    name = register.name
    if isinstance(model, x.XModel) and name in ("present_current", "goal_current", "current_limit"):
        return Unit("A", model.current_unit_a or 1.0)
    if isinstance(model, ax_mx.AxMxModel) and name in ("moving_speed", "present_speed"):
        return Unit("rpm", round(model.speed_unit_counts_s * 60.0 / model.counts_per_turn, 6))
    return UNITS[series_of(model).name].get(name, NO_UNIT)


_QUANTITY: Final = re.compile(r"\s*([+-]?\d+(?:\.\d+)?)\s*(\S*)\s*")
_HEXADECIMAL: Final = re.compile(r"\s*[+-]?0[xX][0-9a-fA-F]+\s*")
_SPELLED: Final = {"c": "°c", "degc": "°c", "us": "µs", "μs": "µs", "counts/s^2": "counts/s²", "rev/min^2": "rev/min²"}
"""Alternative spellings of units that contain characters missing from most keyboards."""


@dataclass(frozen=True, slots=True)
class RegisterValue:
    """A register and its value. ``raw`` is None if the servo does not allow the register to be read."""

    name: str
    address: int
    size: int
    writable: bool
    persistent: bool
    raw: int | None
    value: float | None
    unit: str
    meaning: str

    @property
    def text(self) -> str:
        """Text to show to the user: the quantity, or the number with its meaning."""
        if self.raw is None:
            return "not readable"
        if self.unit:
            return f"{self.value:.6g} {self.unit}"
        return f"{self.raw} ({self.meaning})" if self.meaning else str(self.raw)


def value_of(model: ServoModel, register: Register, raw: int | None) -> RegisterValue:
    """Return a register with its value, unit and meaning."""
    unit = unit_of(model, register)
    return RegisterValue(
        register.name,
        register.address,
        register.size,
        register.access is Access.READ_WRITE,
        register.persistent,
        raw,
        None if raw is None else round(raw * unit.scale, 6),
        unit.symbol,
        "" if raw is None else meaning(model, register, raw),
    )


def parse(model: ServoModel, register: Register, text: str) -> int:
    """Convert a string to a raw register value. The string is a whole number or a quantity with its unit, such as
    12.1V.

    Raises CommissioningError.
    """
    unit = unit_of(model, register)
    if _HEXADECIMAL.fullmatch(text):
        raise CommissioningError(f"{register.name} must be a decimal number, not {text!r}: write {int(text, 16)}")
    match = _QUANTITY.fullmatch(text)
    if match is None:
        raise CommissioningError(f"{register.name} must be a number{_or_quantity(unit.symbol)}, not {text!r}")
    number, symbol = match.groups()
    spelled = _SPELLED.get(symbol.lower(), symbol.lower())
    if spelled and spelled != unit.symbol.lower():
        has = f"the unit {unit.symbol}, not {symbol}" if unit.symbol else f"no unit, so it cannot be set in {symbol}"
        raise CommissioningError(f"{register.name} has {has}")
    if not spelled and "." in number:
        raise CommissioningError(f"{register.name} must be a whole number{_or_quantity(unit.symbol)}, not {text!r}")
    raw = round(float(number) / unit.scale) if spelled else int(number)
    try:
        register.check(raw)
    except ValueError as error:
        raise CommissioningError(str(error)) from error
    return raw


def _or_quantity(symbol: str) -> str:
    return f" (the raw value) or a quantity with the unit {symbol}" if symbol else ""
