"""Registers encode and decode values, and refuse values that do not fit."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.servos import sts
from drivers.servos.register import Access, ByteOrder, Register

BYTE = Register("byte", 0, 1)
WORD = Register("word", 0, 2)
SIGN_10 = Register("sign_10", 0, 2, sign_bit=10)
SIGN_11 = Register("sign_11", 0, 2, sign_bit=11)
SIGN_15 = Register("sign_15", 0, 2, sign_bit=15)
ALL = (BYTE, WORD, SIGN_10, SIGN_11, SIGN_15)


@pytest.mark.parametrize(
    ("register", "value", "little"),
    [
        (BYTE, 0, "00"),
        (BYTE, 255, "ff"),
        (WORD, 2048, "0008"),
        (WORD, 65535, "ffff"),
        (SIGN_15, 1, "0100"),
        (SIGN_15, -1, "0180"),
        (SIGN_15, 32767, "ff7f"),
        (SIGN_15, -32767, "ffff"),
        (SIGN_11, -85, "5508"),
        (SIGN_11, -2047, "ff0f"),
        (SIGN_10, 1000, "e803"),
        (SIGN_10, -1000, "e807"),
    ],
)
def test_a_value_and_its_bytes(register: Register, value: int, little: str) -> None:
    data = bytes.fromhex(little)
    assert register.encode(value, "little") == data
    assert register.decode(data, "little") == value
    assert register.encode(value, "big") == data[::-1]
    assert register.decode(data[::-1], "big") == value


@pytest.mark.parametrize(
    ("register", "low", "high"),
    [(BYTE, 0, 255), (WORD, 0, 65535), (SIGN_10, -1023, 1023), (SIGN_11, -2047, 2047), (SIGN_15, -32767, 32767)],
)
def test_a_value_that_does_not_fit_is_refused_with_the_range(register: Register, low: int, high: int) -> None:
    assert (register.smallest, register.largest) == (low, high)
    for value in (low - 1, high + 1):
        with pytest.raises(ValueError, match=f"{register.name} must be {low} to {high}, not {value}"):
            register.encode(value, "little")


def test_minus_zero_reads_as_zero() -> None:
    assert SIGN_15.decode(b"\x00\x80", "little") == 0


def test_bits_above_the_sign_bit_are_ignored() -> None:
    assert SIGN_10.decode(b"\x05\x08", "little") == 5
    assert SIGN_10.decode(b"\x05\x0c", "little") == -5


@given(st.sampled_from((*ALL, *sts.REGISTERS)), st.sampled_from(("little", "big")), st.data())
def test_every_value_in_range_is_encoded_and_decoded(register: Register, order: ByteOrder, data: st.DataObject) -> None:
    value = data.draw(st.integers(register.smallest, register.largest))
    encoded = register.encode(value, order)
    assert len(encoded) == register.size
    assert register.decode(encoded, order) == value


@given(st.sampled_from((*ALL, *sts.REGISTERS)), st.integers())
def test_a_value_out_of_range_is_refused(register: Register, value: int) -> None:
    if register.takes(value):
        register.check(value)
    else:
        with pytest.raises(ValueError, match="nothing was written"):
            register.check(value)


@given(st.sampled_from(ALL), st.binary(min_size=2, max_size=2))
def test_any_bytes_decode_to_a_value_in_range(register: Register, data: bytes) -> None:
    value = register.decode(data[: register.size], "little")
    assert register.smallest <= value <= register.largest


def test_sts_registers_have_unique_names_and_do_not_overlap() -> None:
    assert len({register.name for register in sts.REGISTERS}) == len(sts.REGISTERS)
    for before, after in pairwise(sts.REGISTERS):
        assert before.address + before.size <= after.address, (before.name, after.name)


def test_persistent_registers_are_before_the_torque_switch_or_after_the_state() -> None:
    for register in sts.REGISTERS:
        persistent = register.address < sts.torque_enable.address or register.address >= 78
        assert register.persistent == persistent, register.name


@pytest.mark.parametrize("block", [sts.STATE_BLOCK, sts.GOAL_BLOCK])
def test_a_block_has_no_gaps(block: tuple[Register, ...]) -> None:
    for before, after in pairwise(block):
        assert before.address + before.size == after.address


def test_goals_can_be_written_and_states_only_read() -> None:
    assert {register.access for register in sts.GOAL_BLOCK} == {Access.READ_WRITE}
    assert {register.access for register in sts.STATE_BLOCK} == {Access.READ}


@pytest.mark.parametrize(
    ("register", "address", "size"),
    [
        (sts.model_number, 3, 2),
        (sts.servo_id, 5, 1),
        (sts.torque_enable, 40, 1),
        (sts.acceleration, 41, 1),
        (sts.goal_position, 42, 2),
        (sts.goal_time, 44, 2),
        (sts.goal_velocity, 46, 2),
        (sts.torque_limit, 48, 2),
        (sts.lock, 55, 1),
        (sts.present_position, 56, 2),
        (sts.present_velocity, 58, 2),
        (sts.present_load, 60, 2),
        (sts.present_voltage, 62, 1),
        (sts.present_temperature, 63, 1),
    ],
)
def test_addresses_that_move_an_arm_agree_with_the_memory_table(register: Register, address: int, size: int) -> None:
    assert (register.address, register.size) == (address, size)


@pytest.mark.parametrize(
    ("status", "names"),
    [
        (0, ()),
        (1, ("voltage",)),
        (0x24, ("temperature", "overload")),
        (0x3F, ("voltage", "angle sensor", "temperature", "current", "angle", "overload")),
        (0xC0, ("unknown (bit 6)", "unknown (bit 7)")),
    ],
)
def test_alarm_names(status: int, names: tuple[str, ...]) -> None:
    assert sts.alarms(status) == names
