"""Effects of reads, writes and other instructions on the control table of one virtual STS servo."""

from math import pi

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.servos import sts
from drivers.servos.register import Register
from sim_backend.packets.instructions import Instruction
from sim_backend.packets.sts import Code, status_packet
from sim_backend.servos.sts.servo import REBOOT_S, VirtualServo

DT_S = 0.001


@pytest.fixture
def servo() -> VirtualServo:
    return VirtualServo(sts.STS3215, 5)


def put(servo: VirtualServo, register: Register, value: int) -> None:
    servo.write(register.address, register.encode(value, "little"))


def get(servo: VirtualServo, register: Register) -> int:
    return register.decode(servo.read(register.address, register.size), "little")


def tick(servo: VirtualServo, milliseconds: int = 1, angle_rad: float = 0.0) -> None:
    for _ in range(milliseconds):
        servo.step(DT_S, angle_rad, 0.0)


def do(servo: VirtualServo, code: int, parameters: bytes = b"") -> bytes | None:
    return servo.answer(Instruction(servo.servo_id, code, parameters))


def test_identification_registers(servo: VirtualServo) -> None:
    assert do(servo, Code.PING) == status_packet(5, 0)
    assert get(servo, sts.model_number) == 777
    assert get(servo, sts.servo_id) == 5
    assert servo.baud == 1_000_000


@pytest.mark.parametrize("address", range(87))
def test_only_registers_0_to_3_and_56_to_77_ignore_writes(servo: VirtualServo, address: int) -> None:
    before = servo.read(address, 1)
    value = bytes((before[0] ^ 2,))
    assert do(servo, Code.WRITE, bytes((address,)) + value) == status_packet(5, 0)
    read_only = address < 4 or 56 <= address < 78
    assert servo.read(address, 1) == (before if read_only else value)


def test_a_write_skips_only_read_only_bytes(servo: VirtualServo) -> None:
    servo.write(54, bytes((7, 0, 9, 9)))
    assert servo.read(54, 4) == bytes((7, 0)) + servo.read(56, 2)
    assert servo.read(56, 1) != b"\x09"


@settings(deadline=None)
@given(st.integers(0, 255), st.binary(min_size=1, max_size=40))
def test_random_writes_raise_no_exception(address: int, data: bytes) -> None:
    servo = VirtualServo(sts.STS3215, 5)
    servo.write(address, data)
    for _ in range(12):
        servo.step(DT_S, 3.0, 0.1)
    assert len(servo.read(0, 250)) == 87


def test_a_read_past_the_end_gets_fewer_bytes_or_no_reply(servo: VirtualServo) -> None:
    assert do(servo, Code.READ, bytes((85, 10))) == status_packet(5, 0, servo.read(85, 2))
    assert do(servo, Code.READ, bytes((87, 1))) is None
    assert do(servo, Code.READ, bytes((200, 4))) is None


def test_an_empty_read_returns_nothing_except_from_address_0(servo: VirtualServo) -> None:
    assert do(servo, Code.READ, bytes((41, 0))) == status_packet(5, 0)
    assert do(servo, Code.READ, bytes((0, 0))) == status_packet(5, 0, servo.read(0, 87))


def test_a_write_past_the_end_is_truncated_and_answered(servo: VirtualServo) -> None:
    assert do(servo, Code.WRITE, bytes((86, 3, 4, 5))) == status_packet(5, 0)
    assert servo.read(86, 1) == b"\x03"
    assert do(servo, Code.WRITE, bytes((87, 3))) == status_packet(5, 0)


@pytest.mark.parametrize(
    ("register", "value"),
    [
        (sts.minimum_startup_force, 16), (sts.protection_current, 310), (sts.velocity_p, 10), (sts.velocity_i, 200),
        (sts.moving_threshold, 2), (sts.dts, 20), (sts.velocity_unit, 50), (sts.hts, 1), (sts.max_velocity, 150),
        (sts.max_acceleration, 100), (sts.acceleration_multiplier, 1), (sts.unloading_condition, 44),
        (sts.led_alarm_condition, 47), (sts.phase, 12), (sts.position_p, 32), (sts.position_d, 32),
        (sts.status_level, 1), (sts.min_position, 0), (sts.max_position, 4095), (sts.max_temperature, 70),
        (sts.max_voltage, 140), (sts.min_voltage, 40), (sts.max_torque, 1000), (sts.position_i, 0),
        (sts.integral_limit, 0), (sts.cw_dead_zone, 1), (sts.ccw_dead_zone, 1), (sts.angular_resolution, 1),
        (sts.operating_mode, 0), (sts.protective_torque, 20), (sts.protection_time, 200), (sts.overload_torque, 80),
        (sts.overcurrent_time, 200), (sts.firmware_major, 3), (sts.firmware_minor, 10),
    ],
    ids=lambda value: value.name if isinstance(value, Register) else "",
)  # fmt: skip
def test_factory_values(servo: VirtualServo, register: Register, value: int) -> None:
    assert get(servo, register) == value


def test_only_baud_rate_and_resolution_are_checked(servo: VirtualServo) -> None:
    for register, value, kept in ((sts.baud_rate, 8, 0), (sts.angular_resolution, 0, 1), (sts.position_p, 255, 255)):
        put(servo, register, value)
        assert get(servo, register) == kept
    put(servo, sts.servo_id, 254)
    assert servo.servo_id == 254


@pytest.mark.parametrize("address", [78, 80, 85, 86])
def test_factory_values_are_in_flash(servo: VirtualServo, address: int) -> None:
    put(servo, sts.lock, 0)
    servo.write(address, b"\x07")
    servo.power_cycle()
    assert servo.read(address, 1) == b"\x07"


def test_eeprom_written_while_locked_lasts_until_power_off(servo: VirtualServo) -> None:
    put(servo, sts.position_p, 16)
    assert get(servo, sts.position_p) == 16
    servo.power_cycle()
    assert get(servo, sts.position_p) == 32


def test_eeprom_written_with_the_lock_open_is_kept(servo: VirtualServo) -> None:
    put(servo, sts.lock, 0)
    put(servo, sts.position_p, 16)
    servo.power_cycle()
    assert get(servo, sts.position_p) == 16
    assert get(servo, sts.lock) == 1


def test_power_off_resets_ram_and_max_torque_becomes_the_limit(servo: VirtualServo) -> None:
    put(servo, sts.lock, 0)
    put(servo, sts.max_torque, 600)
    put(servo, sts.torque_enable, 1)
    put(servo, sts.acceleration, 7)
    put(servo, sts.goal_velocity, 100)
    put(servo, sts.goal_position, 1000)
    tick(servo)
    servo.power_cycle()
    assert [get(servo, r) for r in (sts.acceleration, sts.goal_velocity, sts.async_write_flag)] == [0, 0, 0]
    assert get(servo, sts.torque_limit) == 600
    assert get(servo, sts.torque_enable) == 0
    assert get(servo, sts.goal_position) == 0


def test_a_new_id_and_baud_rate_apply_at_once(servo: VirtualServo) -> None:
    assert do(servo, Code.WRITE, b"\x05\x09") == status_packet(5, 0)
    assert servo.servo_id == 9
    put(servo, sts.baud_rate, 4)
    assert servo.baud == 115_200


def test_status_level_0_answers_only_pings_and_reads(servo: VirtualServo) -> None:
    put(servo, sts.status_level, 0)
    assert do(servo, Code.WRITE, b"\x29\x01") is None
    assert do(servo, Code.REG_WRITE, b"\x29\x01") is None
    assert do(servo, Code.PING) == status_packet(5, 0)
    assert do(servo, Code.READ, b"\x29\x01") == status_packet(5, 0, b"\x01")


def test_a_registered_write_waits_for_the_action(servo: VirtualServo) -> None:
    do(servo, Code.REG_WRITE, b"\x29\x07")
    assert (get(servo, sts.acceleration), get(servo, sts.async_write_flag)) == (0, 1)
    do(servo, Code.ACTION)
    assert (get(servo, sts.acceleration), get(servo, sts.async_write_flag)) == (7, 0)
    put(servo, sts.acceleration, 3)
    do(servo, Code.ACTION)
    assert get(servo, sts.acceleration) == 3


def test_reset_restores_factory_values_but_keeps_the_id(servo: VirtualServo) -> None:
    put(servo, sts.position_p, 1)
    put(servo, sts.baud_rate, 4)
    assert do(servo, Code.RESET) == status_packet(5, 0)
    assert (get(servo, sts.position_p), servo.servo_id, servo.baud) == (32, 5, 1_000_000)


def test_a_reboot_is_not_answered_and_takes_time(servo: VirtualServo) -> None:
    put(servo, sts.torque_enable, 1)
    assert do(servo, Code.REBOOT) is None
    assert servo.deaf
    for _ in range(round(REBOOT_S / DT_S) + 1):
        servo.step(DT_S, 0.0, 0.0)
    assert not servo.deaf
    assert get(servo, sts.torque_enable) == 0


@pytest.mark.parametrize(
    ("code", "parameters"),
    [(Code.WRITE, b"\x29"), (Code.ACTION, b""), (0x07, b""), (0x55, b"abc"), (0x92, b"")],
)
def test_unsupported_instructions_are_answered_with_an_empty_status(
    servo: VirtualServo, code: int, parameters: bytes
) -> None:
    before = servo.read(0, 87)
    assert do(servo, code, parameters) == status_packet(5, 0)
    assert servo.read(0, 87) == before
    put(servo, sts.status_level, 0)
    assert do(servo, code, parameters) is None


def test_a_reset_restores_saved_defaults_and_switches_torque_off(servo: VirtualServo) -> None:
    put(servo, sts.position_p, 16)
    assert do(servo, Code.SAVE_DEFAULTS) == status_packet(5, 0)
    put(servo, sts.position_p, 8)
    put(servo, sts.torque_enable, 1)
    assert do(servo, Code.RESET) == status_packet(5, 0)
    assert (get(servo, sts.position_p), get(servo, sts.torque_enable), servo.servo_id) == (16, 0, 5)


def test_resetting_the_turns_switches_torque_off(servo: VirtualServo) -> None:
    for turn in range(12):
        tick(servo, 20, 3.0 + turn)
    put(servo, sts.torque_enable, 1)
    assert servo.firmware.position > 8000
    assert do(servo, Code.FORGET_TURNS) == status_packet(5, 0)
    tick(servo, 1, 14.0)
    assert 0 <= servo.firmware.position < 4096
    assert get(servo, sts.torque_enable) == 0


@pytest.mark.parametrize("angle_counts", [1, 700, 2048, 3000, 4095])
@pytest.mark.parametrize("count", [None, 10, 1000, 4000])
def test_the_present_angle_can_be_set_to_the_middle_or_any_count(
    servo: VirtualServo, angle_counts: int, count: int | None
) -> None:
    angle_rad = (angle_counts + 0.5) * 2 * pi / 4096
    tick(servo, 50, angle_rad)
    assert get(servo, sts.present_position) == pytest.approx(angle_counts, abs=1)  # a rising count is one short
    put(servo, sts.torque_enable, 1)
    if count is None:
        put(servo, sts.torque_enable, 128)
    else:
        assert do(servo, Code.SET_MIDDLE, count.to_bytes(2, "little")) == status_packet(5, 0)
    for torque in (0 if count is None else 1, 0):
        tick(servo, 1, angle_rad)
        assert get(servo, sts.present_position) == (2048 if count is None else count)
        assert get(servo, sts.torque_enable) == torque
        servo.power_cycle()


def test_setting_the_middle_at_count_0_uses_bit_12_of_the_offset(servo: VirtualServo) -> None:
    """Eleven bits and a sign bit cannot represent 2048."""
    put(servo, sts.torque_enable, 128)
    tick(servo)
    assert get(servo, sts.present_position) == 2048
    assert servo.read(31, 2) == b"\x00\x18"
