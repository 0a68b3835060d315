"""Values that servos accept: every writable register of every model has the range that its control table states."""

import pytest

from drivers.servos import ax_mx, scs, sts, x, xl320
from drivers.servos.catalog import MODELS, registers_of
from drivers.servos.register import Access, Register, ServoModel, between, one_of

FREE = {
    *("secondary_id", "shutdown", "goal_pwm", "goal_velocity", "goal_current", "goal_time"),
    *("homing_offset", "min_position", "max_position", "goal_position"),
    *("cw_compliance_margin", "ccw_compliance_margin", "moving_threshold", "dts", "velocity_unit", "hts"),
    *("max_velocity", "max_acceleration", "acceleration_multiplier"),
    *("external_port_data_1", "external_port_data_2", "external_port_data_3", "present_current"),
}
"""Writable registers that accept every value that fits, or whose limits are the values of other registers."""

REFUSED = [
    (x.XL430_W250, "return_delay", 255, "0 to 254"),
    (x.XL430_W250, "drive_mode", 255, "0 to 13"),
    (x.XL430_W250, "operating_mode", 0, "1, 3, 4 or 16"),
    (x.XL430_W250, "operating_mode", 77, "1, 3, 4 or 16"),
    (x.XL430_W250, "protocol_type", 9, "1 or 2"),
    (x.XL330_M288, "protocol_type", 1, "2, 20, 21 or 22"),
    (x.XL430_W250, "homing_offset", 1_044_480, "-1044479 to 1044479"),
    (x.XL430_W250, "moving_threshold", 5000, "0 to 1023"),
    (x.XL430_W250, "temperature_limit", 200, "0 to 100"),
    (x.XL430_W250, "max_voltage_limit", 500, "60 to 140"),
    (x.XL430_W250, "min_voltage_limit", 0, "60 to 140"),
    (x.XL430_W250, "velocity_limit", 70_000, "0 to 1023"),
    (x.XL430_W250, "max_position_limit", 9000, "0 to 4095"),
    (x.XL430_W250, "min_position_limit", 5000, "0 to 4095"),
    (x.XL430_W250, "velocity_p_gain", 30_000, "0 to 16383"),
    (x.XL430_W250, "bus_watchdog", 200, "0 to 127"),
    (x.XL430_W250, "led", 5, "0 to 1"),
    (x.XL430_W250, "goal_position", 1_048_576, "-1048575 to 1048575"),
    (x.XL330_M288, "baud_rate", 7, "0 to 6"),
    (x.XL330_M288, "current_limit", 1800, "0 to 1750"),
    (x.XL330_M288, "pwm_slope", 0, "1 to 255"),
    (x.XM430_W350, "max_voltage_limit", 90, "95 to 160"),
    (xl320.XL320, "control_mode", 0, "1 or 2"),
    (ax_mx.AX_12A, "ccw_angle_limit", 1024, "0 to 1023"),
    (ax_mx.MX_28, "resolution_divider", 0, "1 to 4"),
    (sts.STS3215, "operating_mode", 4, "0 to 3"),
    (sts.STS3215, "torque_enable", 3, "0, 1, 2 or 128"),
    (sts.STS3215, "max_torque", 1001, "0 to 1000"),
    (scs.SCS15, "max_position", 1024, "0 to 1023"),
]
"""Values that a servo refuses, with the accepted ones. The examples for X servos are those of the e-manual."""


def named(model: ServoModel, name: str) -> Register:
    return next(register for register in registers_of(model) if register.name == name)


@pytest.mark.parametrize(("model", "name", "value", "accepted"), REFUSED, ids=lambda v: getattr(v, "name", None))
def test_a_value_outside_the_table_is_refused_with_the_accepted_values(
    model: ServoModel, name: str, value: int, accepted: str
) -> None:
    register = named(model, name)
    assert not register.takes(value)
    with pytest.raises(ValueError, match=f"^{name} must be {accepted}, not {value}: nothing was written$"):
        register.check(value)


@pytest.mark.parametrize("model", MODELS.values(), ids=lambda model: model.name)
def test_every_writable_register_has_values_that_fit(model: ServoModel) -> None:
    for register in registers_of(model):
        writable = register.access is Access.READ_WRITE
        assert bool(register.values) or not writable or register.name in FREE, register.name
        for span in register.values:
            assert writable and len(span) > 0 and span[0] in register.fitting and span[-1] in register.fitting
        register.check(register.smallest)
        register.check(register.largest)


def test_models_share_a_register_whose_values_differ() -> None:
    ours, theirs = named(x.XL430_W250, "operating_mode"), named(x.XM430_W350, "operating_mode")
    assert ours == theirs
    assert ours.takes(1) and theirs.takes(1)
    assert theirs.takes(5) and not ours.takes(5)


def test_values_in_a_message() -> None:
    assert Register("free", 0, 1).values_text == "0 to 255"
    assert Register("list", 0, 1, values=between(0, 3)).values_text == "0 to 3"
    assert Register("modes", 0, 1, values=one_of(1) + between(3, 4)).values_text == "1 or 3 to 4"
