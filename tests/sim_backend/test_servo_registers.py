"""What reads, writes and the other instructions do to one virtual servo's control table."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.servos import sts
from drivers.servos.register import Access, Register
from sim_backend.instructions import Instruction
from sim_backend.servo import REBOOT_S, VirtualServo
from sim_backend.sts_wire import Code, status_packet

DT_S = 0.001


@pytest.fixture
def servo() -> VirtualServo:
    return VirtualServo(sts.STS3215, 5)


def put(servo: VirtualServo, register: Register, value: int) -> None:
    servo.write(register.address, register.encode(value, "little"))


def get(servo: VirtualServo, register: Register) -> int:
    return register.decode(servo.read(register.address, register.size), "little")


def do(servo: VirtualServo, code: Code, parameters: bytes = b"") -> bytes | None:
    return servo.answer(Instruction(servo.servo_id, code, parameters))


def test_it_introduces_itself(servo: VirtualServo) -> None:
    assert do(servo, Code.PING) == status_packet(5, 0)
    assert get(servo, sts.model_number) == 777
    assert get(servo, sts.servo_id) == 5
    assert servo.baud == 1_000_000


@pytest.mark.parametrize("register", [r for r in sts.REGISTERS if r.access is Access.READ])
def test_read_only_registers_ignore_writes(servo: VirtualServo, register: Register) -> None:
    before = servo.read(register.address, register.size)
    assert do(servo, Code.WRITE, bytes((register.address,)) + b"\x55" * register.size)
    assert servo.read(register.address, register.size) == before


@settings(deadline=None)
@given(st.integers(0, 255), st.binary(min_size=1, max_size=40))
def test_no_write_upsets_a_servo(address: int, data: bytes) -> None:
    servo = VirtualServo(sts.STS3215, 5)
    servo.write(address, data)
    for _ in range(12):
        servo.step(DT_S, 3.0, 0.1)
    assert len(servo.read(0, 250)) == 250
    assert servo.servo_id <= 0xFD


def test_eeprom_written_under_the_lock_lasts_until_power_off(servo: VirtualServo) -> None:
    put(servo, sts.position_p, 16)
    assert get(servo, sts.position_p) == 16
    servo.power_cycle()
    assert get(servo, sts.position_p) == 32


def test_eeprom_written_with_the_lock_open_stays(servo: VirtualServo) -> None:
    put(servo, sts.lock, 0)
    put(servo, sts.position_p, 16)
    servo.power_cycle()
    assert get(servo, sts.position_p) == 16
    assert get(servo, sts.lock) == 1


def test_ram_is_forgotten_and_max_torque_becomes_the_limit(servo: VirtualServo) -> None:
    put(servo, sts.lock, 0)
    put(servo, sts.max_torque, 600)
    put(servo, sts.torque_enable, 1)
    put(servo, sts.goal_position, 1000)
    servo.power_cycle()
    assert get(servo, sts.torque_limit) == 600
    assert get(servo, sts.torque_enable) == 0
    assert get(servo, sts.goal_position) == 0


def test_a_new_id_and_baud_hold_at_once_and_senseless_ones_never(servo: VirtualServo) -> None:
    assert do(servo, Code.WRITE, b"\x05\x09") == status_packet(5, 0)
    assert servo.servo_id == 9
    put(servo, sts.baud_rate, 4)
    assert servo.baud == 115_200
    servo.write(sts.servo_id.address, b"\xfe")
    servo.write(sts.baud_rate.address, b"\x08")
    assert (servo.servo_id, servo.baud) == (9, 115_200)


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


def test_a_reboot_is_not_answered_and_takes_its_time(servo: VirtualServo) -> None:
    put(servo, sts.torque_enable, 1)
    assert do(servo, Code.REBOOT) is None
    assert servo.deaf
    for _ in range(round(REBOOT_S / DT_S) + 1):
        servo.step(DT_S, 0.0, 0.0)
    assert not servo.deaf
    assert get(servo, sts.torque_enable) == 0


@pytest.mark.parametrize("code", [Code.READ, Code.WRITE, Code.REG_WRITE])
def test_malformed_instructions_are_not_answered(servo: VirtualServo, code: Code) -> None:
    assert do(servo, code, b"\x29") is None


@pytest.mark.parametrize("angle_counts", [0, 1, 700, 2048, 3000, 4095])
def test_128_calls_the_present_position_the_middle(servo: VirtualServo, angle_counts: int) -> None:
    angle_rad = (angle_counts + 0.5) / servo.firmware._counts_per_rad
    servo.step(DT_S, angle_rad, 0.0)
    assert get(servo, sts.present_position) == angle_counts
    put(servo, sts.torque_enable, 128)
    servo.step(DT_S, angle_rad, 0.0)
    # The offset has 11 bits: from count 0 the middle is one count out of reach.
    assert abs(get(servo, sts.present_position) - 2048) <= (angle_counts == 0)
    assert get(servo, sts.torque_enable) == 0
    servo.power_cycle()
    assert abs(get(servo, sts.present_position) - 2048) <= (angle_counts == 0)


def test_reading_beyond_the_table_gives_zeros(servo: VirtualServo) -> None:
    assert servo.read(250, 10) == bytes(10)
