"""Differences between the virtual X series models: factory values and firmware. Source: e-manual."""

from typing import Final

from drivers.servos import x
from drivers.servos.register import Register

FACTORY: Final[dict[Register, int]] = {
    x.firmware_version: 46,  # assumed
    x.servo_id: 1,
    x.baud_rate: 1,
    x.return_delay: 250,
    x.operating_mode: x.POSITION_MODE,
    x.secondary_id: 255,
    x.protocol_type: 2,
    x.moving_threshold: 10,
    x.pwm_limit: x.FULL_PWM,
    x.max_position_limit: 4095,
    x.status_return_level: 2,
}
"""Factory values of all models. Registers that are neither here nor in ``factory_of`` are 0."""

_OWN_REGISTERS: Final = (
    x.temperature_limit,
    x.max_voltage_limit,
    x.min_voltage_limit,
    x.velocity_limit,
    x.shutdown,
    x.velocity_i_gain,
    x.velocity_p_gain,
    x.position_d_gain,
    x.position_i_gain,
    x.position_p_gain,
)
_OWN_VALUES: Final = {
    x.XL330_M077.name: (70, 70, 35, 1620, 53, 400, 40, 0, 400, 400),
    x.XL330_M288.name: (70, 70, 35, 445, 53, 1600, 180, 0, 0, 400),
    x.XC330_M181.name: (70, 70, 35, 545, 52, 1400, 100, 500, 0, 1200),
    x.XC330_M288.name: (70, 70, 35, 350, 52, 1600, 50, 500, 0, 1100),
    x.XC330_T181.name: (70, 140, 55, 510, 52, 1200, 40, 0, 0, 900),
    x.XC330_T288.name: (70, 140, 55, 320, 52, 1200, 40, 0, 0, 900),
    x.XL430_W250.name: (72, 140, 60, 265, 52, 1000, 100, 4000, 0, 640),
    x.XC430_W150.name: (80, 160, 60, 460, 52, 1920, 100, 0, 0, 460),
    x.XC430_W240.name: (80, 160, 60, 306, 52, 1920, 100, 0, 0, 700),
    x.XM430_W210.name: (80, 160, 95, 330, 52, 1920, 100, 0, 0, 800),
    x.XM430_W350.name: (80, 160, 95, 350, 52, 1920, 100, 0, 0, 800),
    x.MX_28_2.name: (80, 160, 95, 380, 52, 1920, 100, 0, 0, 850),
}
_OWN: Final = {name: dict(zip(_OWN_REGISTERS, values, strict=True)) for name, values in _OWN_VALUES.items()}
_CURRENT_LIMITS: Final = {
    x.XL330_M077.name: 1750,
    x.XL330_M288.name: 1750,
    x.XC330_M181.name: 2352,
    x.XC330_M288.name: 2352,
    x.XC330_T181.name: 910,
    x.XC330_T288.name: 910,
    x.XM430_W210.name: 1193,
    x.XM430_W350.name: 1193,
}
"""Current limit by model name, in the model's unit."""

_FAST_READ_SINCE: Final = {
    x.XL330_M077.name: 46,
    x.XL330_M288.name: 46,
    x.XC330_M181.name: 46,
    x.XC330_M288.name: 46,
    x.XC330_T181.name: 46,
    x.XC330_T288.name: 46,
    x.XL430_W250.name: 45,
    x.XC430_W150.name: 45,
    x.XC430_W240.name: 45,
    x.XM430_W210.name: 45,
    x.XM430_W350.name: 45,
}
"""First firmware version with fast reads, for the models in the e-manual's list of "Fast Sync Read"."""

_OTHER_VALUES: Final = {x.XC430_W150.name: {x.moving_threshold: 20}}
"""Values that differ from ``FACTORY``, by model name."""
_SLOPES: Final = {x.pwm_slope: 140, x.acceleration_limit: 32767}
"""Registers that only some models have."""


def factory_of(model: x.XModel) -> dict[Register, int]:
    """Return all factory values of a model that are not 0.

    An unlisted model gets the values of the XM430-W350 (assumed). Its voltage limits are a third above and a fifth
    below the rated voltage, and its current limit is the stall current.
    """
    rated = model.rated_voltage_v / x.VOLTAGE_UNIT_V
    limits = {x.max_voltage_limit: round(rated * 4 / 3), x.min_voltage_limit: round(rated * 4 / 5)}
    own = _OWN.get(model.name, _OWN[x.XM430_W350.name] | limits)
    own |= _OTHER_VALUES.get(model.name, {})
    own |= {register: _SLOPES[register] for register in model.own if register in _SLOPES}
    if model.current_unit_a is None:
        return FACTORY | own
    stall = min(round(model.stall_current_a / model.current_unit_a), x.current_limit.largest)
    return FACTORY | own | {x.current_limit: _CURRENT_LIMITS.get(model.name, stall)}


_TIME_PROFILE_SINCE: Final = 42
"""First firmware version with time-based profiles, clear, and without a broadcast factory reset. All X330 have them."""


def follows_42(model: x.XModel, firmware: int) -> bool:
    """Whether the firmware has what version 42 brought: time-based profiles, and the clear instruction."""
    return model.short_map or firmware >= _TIME_PROFILE_SINCE


def reads_fast(model: x.XModel, firmware: int) -> bool:
    """Whether a servo with this firmware version supports fast reads. An unlisted model never does.

    The same versions brought torque on by goal, the startup configuration and the backup of the control table.
    """
    return model.name in _FAST_READ_SINCE and firmware >= _FAST_READ_SINCE[model.name]
