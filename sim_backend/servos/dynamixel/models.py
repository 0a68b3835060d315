"""Differences between the virtual X series models: factory values and firmware. Source: e-manual."""

from math import pi
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
"""Factory values of all models. Registers that are in neither this mapping nor ``factory_of`` are 0."""

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
    x.MX_64_2.name: (80, 160, 95, 435, 52, 1920, 100, 0, 0, 850),
    x.MX_106_2.name: (80, 160, 95, 360, 52, 1920, 100, 0, 0, 850),
    x.XH430_W210.name: (80, 160, 95, 210, 52, 1920, 100, 0, 0, 900),
    x.XH430_W350.name: (80, 160, 95, 130, 52, 1920, 100, 0, 0, 900),
    x.XD430_T210.name: (80, 160, 95, 210, 52, 1920, 100, 0, 0, 900),
    x.XD430_T350.name: (80, 160, 95, 130, 52, 1920, 100, 0, 0, 900),
    x.XH430_V210.name: (80, 300, 110, 380, 52, 1920, 100, 0, 0, 800),
    x.XH430_V350.name: (80, 300, 110, 285, 52, 1920, 100, 0, 0, 800),
    x.XM540_W270.name: (80, 160, 95, 128, 52, 1920, 100, 0, 0, 800),
    x.XM540_W150.name: (80, 160, 95, 230, 52, 1920, 100, 0, 0, 800),
    x.XH540_W150.name: (80, 160, 95, 300, 52, 1920, 100, 0, 0, 800),
    x.XH540_W270.name: (80, 160, 95, 167, 52, 1920, 100, 0, 0, 800),
    x.XH540_V270.name: (80, 300, 110, 128, 52, 1920, 100, 0, 0, 800),
    x.XD540_T150.name: (80, 160, 95, 300, 52, 1920, 100, 0, 0, 800),
    x.XD540_T270.name: (80, 160, 95, 167, 52, 1920, 100, 0, 0, 800),
    x.XW540_T140.name: (80, 160, 95, 304, 52, 1920, 100, 0, 0, 800),
    x.XW540_T260.name: (80, 160, 95, 167, 52, 1920, 100, 0, 0, 800),
    x.XH540_V150.name: (80, 300, 110, 230, 52, 1920, 100, 0, 0, 800),
    x.XW540_H260.name: (80, 300, 110, 145, 52, 1920, 100, 0, 0, 800),
    x.XW430_T333.name: (80, 160, 95, 139, 52, 1920, 100, 0, 0, 900),
    x.TWO_XL430_W250.name: (72, 140, 60, 265, 52, 1000, 100, 4000, 0, 640),
    x.TWO_XC430_W250.name: (80, 160, 60, 275, 52, 1920, 100, 0, 0, 700),
}
_OWN: Final = {name: dict(zip(_OWN_REGISTERS, values, strict=True)) for name, values in _OWN_VALUES.items()}

_VELOCITY_UNIT_RAD_S: Final = 0.229 * 2.0 * pi / 60.0
_OTHER_VALUES: Final = {x.XC430_W150.name: {x.moving_threshold: 20}}
"""Values that differ from ``FACTORY``, keyed by model name."""
_SLOPES: Final = {x.pwm_slope: 140, x.acceleration_limit: 32767}
"""Registers that only some models have."""


def factory_of(model: x.XModel) -> dict[Register, int]:
    """Return all nonzero factory values of a model.

    A model without a table in the e-manual (the XC335-T332 and models added by users) has the gains of the XM430-W350
    (assumed). Its velocity limit is 20 % above its no-load speed. The voltage and current limits of such a model are
    the widest that its table permits.
    """
    held = {register.name: register for register in model.own}
    unlisted = {
        x.max_voltage_limit: held["max_voltage_limit"].largest,
        x.min_voltage_limit: held["min_voltage_limit"].smallest,
        x.velocity_limit: round(1.2 * model.no_load_speed_rad_s / _VELOCITY_UNIT_RAD_S),
    }
    own = _OWN.get(model.name, _OWN[x.XM430_W350.name] | unlisted)
    own = own | _OTHER_VALUES.get(model.name, {})
    own |= {register: _SLOPES[register] for register in model.own if register in _SLOPES}
    if model.current_unit_a is not None:
        own[x.current_limit] = held["current_limit"].largest
    return FACTORY | own


_TIME_PROFILE_SINCE: Final = 42
"""First firmware version that has time-based profiles and the clear instruction, but no broadcast factory reset. All
X330 have them."""


def follows_42(model: x.XModel, firmware: int) -> bool:
    """Return whether the firmware has the features of version 42: time-based profiles, and the clear instruction."""
    return model.short_map or firmware >= _TIME_PROFILE_SINCE


def reads_fast(model: x.XModel, firmware: int) -> bool:
    """Return whether a servo with this firmware version supports fast reads, according to the list in the section "Fast
    Sync Read" of the e-manual.

    The same versions introduced enabling torque by writing a goal, the startup configuration, and the control table
    backup.
    """
    if x.acceleration_limit in model.own:  # an MX
        return False
    return firmware >= (46 if x.pwm_slope in model.own else 45)
