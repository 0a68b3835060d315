"""Indirect addresses of a virtual X series servo, which place bytes of other registers side by side."""

import math
from typing import Any

import pytest

from drivers.servos import x
from drivers.servos.register import Register
from sim_backend.servos.dynamixel.indirect import LONG, MIDDLE, SHORT, Window, windows_of
from sim_backend.servos.dynamixel.servo import VirtualXServo

USUAL = 46
ALL = pytest.mark.parametrize("model", x.MODELS.values(), ids=lambda model: model.name)


def windows(model: Any) -> tuple[Window, ...]:
    return windows_of(model, USUAL)


def a_servo(model: Any = x.XL430_W250) -> VirtualXServo:
    servo = VirtualXServo(model, 1)
    servo.firmware.observe(math.pi)
    servo.step(0.001, math.pi, 0.0)
    return servo


def read(servo: VirtualXServo, address: int, size: int) -> int:
    return int.from_bytes(servo.memory.read(address, size), "little")


def point(servo: VirtualXServo, number: int, *registers: Register, window: int = 0) -> int:
    """Map the cells from ``number`` on (0 is the first cell) to these registers. Return the address of the first
    cell."""
    table = windows(servo.model)[window]
    targets = [register.address + i for register in registers for i in range(register.size)]
    data = b"".join(target.to_bytes(2, "little") for target in targets)
    assert servo.write(table.addresses + 2 * number, data) == 0
    return table.data + number


def test_addresses_of_indirect_registers() -> None:
    assert [[(w.addresses, w.data, w.count) for w in windows] for windows in (LONG, MIDDLE, SHORT)] == [
        [(168, 224, 28), (578, 634, 28)],
        [(168, 224, 28)],
        [(168, 208, 20)],
    ]
    for name, model in x.MODELS.items():
        old, new = windows_of(model, 52), windows_of(model, 53)
        middle = (MIDDLE, MIDDLE) if "335" in name else (LONG, LONG)
        assert (old, new) == ((SHORT, MIDDLE) if "330" in name else middle)


def test_newer_firmware_has_indirect_registers_at_other_addresses() -> None:
    servo = VirtualXServo(x.XL330_M288, 1, 53)
    assert servo.memory.get(x.firmware_version) == 53
    assert read(servo, 168, 2) == 224
    assert servo.write(168, (251).to_bytes(2, "little")) == 0
    assert servo.write(168, (252).to_bytes(2, "little")) == 4


@ALL
def test_indirect_addresses_can_be_read_and_are_reset_by_a_reboot(model: Any) -> None:
    servo = a_servo(model)
    window = windows(model)[0]
    assert servo.write(window.addresses, window.addresses.to_bytes(2, "little")) == 0
    assert read(servo, window.data, 1) == window.addresses & 0xFF
    servo.power_cycle()
    assert read(servo, window.data, 1) == 0


@ALL
def test_at_first_each_cell_stands_for_itself(model: Any) -> None:
    servo = a_servo(model)
    for window in windows(model):
        for i in range(window.count):
            assert read(servo, window.addresses + 2 * i, 2) == window.data + i
        assert servo.write(window.data, b"\x01\x02\x03") == 0
        assert servo.memory.read(window.data, 4) == b"\x01\x02\x03\0"


@ALL
def test_reads_and_writes_reach_the_target(model: Any) -> None:
    servo = a_servo(model)
    for window in range(len(windows(model))):
        at = point(servo, 2, x.torque_enable, x.goal_position, window=window)
        assert servo.write(at, b"\x01" + (1234).to_bytes(4, "little")) == 0
        assert (servo.memory.get(x.torque_enable), servo.memory.get(x.goal_position)) == (1, 1234)
        servo.memory.put(x.torque_enable, 0)
        assert read(servo, at, 1) == 0
        assert read(servo, at + 1, 4) == 1234


def test_the_firmware_notices_indirect_writes() -> None:
    servo = a_servo()
    at = point(servo, 0, x.torque_enable, x.profile_velocity, x.goal_position)
    assert servo.write(at, b"\x01" + (50).to_bytes(4, "little") + (3000).to_bytes(4, "little")) == 0
    assert servo.firmware.profile.goal == 3000.0
    assert servo.memory.get(x.torque_enable) == 1


def test_distant_registers_are_read_in_one_span() -> None:
    servo = a_servo()
    at = point(servo, 0, x.present_position, x.present_temperature, x.hardware_error_status)
    status = servo.read_status(at, 6)
    assert status[9:13] == (2048).to_bytes(4, "little")
    assert status[13:15] == bytes((servo.memory.get(x.present_temperature), 0))
    assert status[13] > 0


@pytest.mark.parametrize(
    ("register", "data", "error"),
    [
        (x.present_position, b"\0\0\0\0", 7),
        (x.torque_enable, b"\x02", 4),
        (x.goal_position, (4096).to_bytes(4, "little"), 6),
        (x.goal_position, b"\x01\x02", 5),
    ],
)
def test_access_rules_of_the_target_apply(register: Register, data: bytes, error: int) -> None:
    servo = a_servo()
    before = servo.memory.get(register)
    at = point(servo, 0, register)
    assert servo.write(at, data) == error
    assert servo.memory.get(register) == before


def test_bytes_of_a_register_out_of_order_are_refused() -> None:
    servo = a_servo()
    window = windows(servo.model)[0]
    swapped = b"".join((x.goal_pwm.address + i).to_bytes(2, "little") for i in (1, 0))
    assert servo.write(window.addresses, swapped) == 0
    assert servo.write(window.data, b"\0\0") == 7


def test_one_refused_target_refuses_the_whole_write() -> None:
    servo = a_servo()
    at = point(servo, 0, x.led, x.moving)
    assert servo.write(at, b"\x01\x01") == 7
    assert servo.memory.get(x.led) == 0


@ALL
def test_only_ram_can_be_addressed_indirectly(model: Any) -> None:
    servo = a_servo(model)
    window, last = windows(model)[0], windows(model)[-1]
    for target, error in ((63, 4), (64, 0), (last.data + last.count - 1, 0), (last.data + last.count, 4)):
        assert servo.write(window.addresses, target.to_bytes(2, "little")) == error


def test_indirect_addresses_are_writable_under_torque_and_lost_at_power_off() -> None:
    servo = a_servo()
    assert servo.write(x.torque_enable.address, b"\x01") == 0
    at = point(servo, 0, x.led)
    assert servo.write(at, b"\x01") == 0
    servo.power_cycle()
    window = windows(servo.model)[0]
    assert read(servo, window.addresses, 2) == window.data
    assert read(servo, at, 1) == 0


def test_a_cell_that_names_a_cell_stands_for_its_own_byte() -> None:
    servo = a_servo()
    point(servo, 1, x.led)
    window = windows(servo.model)[0]
    assert servo.write(window.addresses, (window.data + 1).to_bytes(2, "little")) == 0
    assert servo.write(window.data, b"\x01") == 0
    assert (servo.memory.get(x.led), read(servo, window.data, 1)) == (0, 1)


def test_indirect_writes_cannot_enable_the_torque_after_a_shutdown() -> None:
    servo = a_servo()
    at = point(servo, 0, x.led, x.torque_enable)
    servo.firmware.protection.released = True
    assert servo.write(at, b"\x01\x01") == 1
    assert (servo.memory.get(x.torque_enable), servo.memory.get(x.led)) == (0, 0)
