"""The control table of the X series compared with the e-manual, and two's complement numbers."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.servos import x
from drivers.servos.register import Access, Register, ServoModel

MODELS = tuple(x.MODELS.values())
ALL = tuple({register for model in MODELS for register in x.registers(model)})


@pytest.mark.parametrize(
    ("register", "value", "data"),
    [
        (x.present_pwm, -1, "ffff"),
        (x.present_pwm, -32768, "0080"),
        (x.present_position, -1, "ffffffff"),
        (x.present_position, 4095, "ff0f0000"),
        (x.homing_offset, -1044479, "0110f0ff"),
        (x.profile_velocity, 0xFFFFFFFF, "ffffffff"),
    ],
)
def test_a_value_and_its_bytes(register: Register, value: int, data: str) -> None:
    assert register.encode(value, "little") == bytes.fromhex(data)
    assert register.decode(bytes.fromhex(data), "little") == value


@given(st.sampled_from(ALL), st.data())
def test_every_value_in_range_is_encoded_and_decoded(register: Register, data: st.DataObject) -> None:
    value = data.draw(st.integers(register.smallest, register.largest))
    encoded = register.encode(value, "little")
    assert len(encoded) == register.size
    assert register.decode(encoded, "little") == value


@given(st.sampled_from(ALL), st.data())
def test_any_bytes_are_decoded_and_encoded(register: Register, data: st.DataObject) -> None:
    raw = data.draw(st.binary(min_size=register.size, max_size=register.size))
    assert register.encode(register.decode(raw, "little"), "little") == raw


@given(st.sampled_from(ALL), st.integers())
def test_a_value_out_of_range_is_refused(register: Register, value: int) -> None:
    if not register.takes(value):
        with pytest.raises(ValueError, match="nothing was written"):
            register.check(value)


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
def test_registers_have_unique_names_and_do_not_overlap(model: ServoModel) -> None:
    registers = x.registers(model)
    assert len({register.name for register in registers}) == len(registers)
    for before, after in pairwise(registers):
        assert before.address + before.size <= after.address, (before.name, after.name)
    for register in registers:
        assert register.persistent == (register.address < x.torque_enable.address), register.name


@pytest.mark.parametrize(
    ("model", "number", "measures"),
    [
        (x.XL330_M077, 1190, x.present_current),
        (x.XL330_M288, 1200, x.present_current),
        (x.XC330_T288, 1220, x.present_current),
        (x.XL430_W250, 1060, x.present_load),
        (x.XM430_W350, 1020, x.present_current),
    ],
)
def test_the_models_and_their_register_at_126(model: ServoModel, number: int, measures: Register) -> None:
    assert model.number == number
    assert measures in x.registers(model)
    assert sum(register.address == 126 for register in x.registers(model)) == 1


@pytest.mark.parametrize(
    ("register", "address", "size"),
    [
        (x.operating_mode, 11, 1),
        (x.pwm_limit, 36, 2),
        (x.torque_enable, 64, 1),
        (x.hardware_error_status, 70, 1),
        (x.position_p_gain, 84, 2),
        (x.goal_pwm, 100, 2),
        (x.profile_acceleration, 108, 4),
        (x.profile_velocity, 112, 4),
        (x.goal_position, 116, 4),
        (x.present_pwm, 124, 2),
        (x.present_velocity, 128, 4),
        (x.present_position, 132, 4),
        (x.present_voltage, 144, 2),
        (x.present_temperature, 146, 1),
    ],
)
def test_addresses_that_move_an_arm_agree_with_the_manual(register: Register, address: int, size: int) -> None:
    assert (register.address, register.size) == (address, size)


def test_the_goal_block_has_no_gap_and_can_be_written() -> None:
    before, after = x.GOAL_BLOCK
    assert before.address + before.size == after.address
    assert {register.access for register in x.GOAL_BLOCK} == {Access.READ_WRITE}


@pytest.mark.parametrize(
    ("bits", "names"),
    [
        (0, ()),
        (0x20, ("overload",)),
        (0x35, ("voltage", "temperature", "electrical shock", "overload")),
        (0x82, ("unknown (bit 1)", "unknown (bit 7)")),
    ],
)
def test_alarm_names(bits: int, names: tuple[str, ...]) -> None:
    assert x.alarms(bits) == names
