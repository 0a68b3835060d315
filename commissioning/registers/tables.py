"""The control table of one servo model: registers, baud rates and the meaning of coded values."""

from difflib import get_close_matches
from typing import Final

from commissioning.commissioning_errors import CommissioningError
from commissioning.scan.examine import MODES
from drivers.servos import sts, x, xl320
from drivers.servos.catalog import known_as, registers_of, series_of
from drivers.servos.dynamixel1 import AX_MX
from drivers.servos.register import Register, ServoModel

AX_RATES: Final = {value: rate for value, rate in enumerate((0, 1_000_000, 0, 500_000, 400_000)) if rate} | {
    7: 250_000,
    9: 200_000,
    16: 115_200,
    34: 57_600,
    103: 19_200,
    207: 9_600,
}
"""Nominal baud rates of Dynamixel protocol 1.0, keyed by register value: 2 Mbit/s divided by the value plus one."""
MX_RATES: Final = {250: 2_250_000, 251: 2_500_000, 252: 3_000_000}
"""Additional baud rates of MX servos, keyed by register value."""


def register_named(model: ServoModel, name: str) -> Register:
    """Return a register by name.

    If the model does not have this register, raise CommissioningError with a list of similar names.
    """
    table = {register.name: register for register in registers_of(model)}
    if name in table:
        return table[name]
    near = get_close_matches(name, table)
    meant = f"did you mean {' or '.join(near)}? " if near else ""
    raise CommissioningError(
        f"{model.name} has no register {name}: {meant}'servoloop register list' lists all registers"
    )


def rates_of(model: ServoModel) -> dict[int, int]:
    """Return a model's baud rates, keyed by the value of its ``baud_rate`` register."""
    series = series_of(model)
    if series is AX_MX:
        return AX_RATES | (MX_RATES if series.bulk_read(model) else {})
    if series.make == "feetech":
        return dict(enumerate(sts.BAUD_RATES))
    rates = xl320.BAUD_RATES if model is xl320.XL320 else x.BAUD_RATES
    return dict(enumerate(rates[: register_named(model, "baud_rate").largest + 1]))


def meaning(model: ServoModel, register: Register, raw: int) -> str:
    """Return the meaning of a coded value; an empty string if it is unknown or the register holds a quantity."""
    series = series_of(model)
    mode, names = MODES.get(series.name, (None, {}))
    if register == mode:
        return names.get(raw, "")
    if register.name == "model_number":
        return known_as(raw, series)
    if register.name == "baud_rate":
        return f"{rates_of(model)[raw]} baud" if raw in rates_of(model) else ""
    if register.name == "torque_enable":
        return {0: "off", 1: "on"}.get(raw, "")
    if register.name == "status":
        return ", ".join(sts.alarms(raw))
    if series.hardware_error and register == series.hardware_error[0]:
        return ", ".join(series.hardware_error[1](raw))
    return ""
