"""One virtual X series servo with the single-servo instructions of the official SDK over our port."""

from typing import Any

import pytest

from drivers.bus.sdk_adapter import SdkAdapter
from drivers.port.line import Line
from drivers.servos import x
from drivers.servos.register import Access, Register
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.port import VirtualPort
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.servos.dynamixel.protocol2_servo import REBOOT_S
from sim_backend.servos.dynamixel.servo import VirtualXServo
from tests.sim_backend.dynamixel_bench import Bench, handler, sdk


@pytest.mark.parametrize("model", x.MODELS.values(), ids=lambda model: model.name)
def test_factory_values(model: Any) -> None:
    servo = VirtualXServo(model, 9)
    get = servo.memory.get
    assert (get(x.model_number), get(x.servo_id), servo.baud, get(x.operating_mode)) == (model.number, 9, 57_600, 3)
    assert (get(x.torque_enable), get(x.goal_pwm), get(x.max_position_limit)) == (0, 885, 4095)
    for register in x.registers(model):
        if register.access is Access.READ:
            assert servo.write(register.address, bytes(register.size)) == 7


def test_ping_read_write_and_broadcast_ping() -> None:
    bench = Bench()
    assert handler.ping(bench.port, 1) == (1060, sdk.COMM_SUCCESS, 0)
    assert handler.ping(bench.port, 2)[1] == sdk.COMM_RX_TIMEOUT
    assert handler.broadcastPing(bench.port) == ({1: [1060, 46]}, sdk.COMM_SUCCESS)
    assert bench.write(x.led, 1) == 0
    assert bench.read(x.led) == 1


def test_reg_write_waits_for_action() -> None:
    bench = Bench()
    assert handler.regWriteTxRx(bench.port, 1, x.led.address, 1, [1]) == (sdk.COMM_SUCCESS, 0)
    assert (bench.read(x.led), bench.read(x.registered_instruction)) == (0, 1)
    assert handler.action(bench.port, 1) == sdk.COMM_SUCCESS
    bench.run(0.001)  # the SDK does not wait for the reply
    assert (bench.read(x.led), bench.read(x.registered_instruction)) == (1, 0)


def test_a_factory_reset_keeps_the_selected_registers() -> None:
    bench = Bench()
    bench.write(x.homing_offset, -5)
    assert handler.factoryReset(bench.port, 1, 0x02) == (sdk.COMM_SUCCESS, 0)
    bench.run(REBOOT_S + 0.01)
    assert bench.read(x.homing_offset) == 0


def test_a_reboot_resets_ram_and_keeps_eeprom() -> None:
    bench = Bench()
    bench.write(x.homing_offset, 100)
    bench.write(x.position_p_gain, 2000)
    bench.write(x.torque_enable, 1)
    assert handler.reboot(bench.port, 1) == (sdk.COMM_SUCCESS, 0)
    assert handler.ping(bench.port, 1)[1] == sdk.COMM_RX_TIMEOUT
    bench.run(REBOOT_S)
    values = [bench.read(r) for r in (x.homing_offset, x.position_p_gain, x.torque_enable, x.present_position)]
    assert values == [100, 640, 0, 2148]


@pytest.mark.parametrize(
    ("register", "value", "error"),
    [
        (x.goal_position, 4096, 6),
        (x.goal_pwm, 886, 6),
        (x.torque_enable, 2, 4),
        (x.profile_velocity, 32768, 4),
        (x.present_position, 1, 7),
    ],
)
def test_refused_writes_have_no_effect(register: Register, value: int, error: int) -> None:
    bench = Bench()
    before = bench.read(register)
    assert bench.write(register, value) == error
    assert bench.read(register) == before


def test_eeprom_is_locked_under_torque() -> None:
    bench = Bench()
    bench.write(x.torque_enable, 1)
    assert bench.write(x.homing_offset, 1) == 7
    assert handler.write2ByteTxRx(bench.port, 1, x.goal_position.address, 1) == (sdk.COMM_SUCCESS, 5)


def test_status_return_levels() -> None:
    bench = Bench()
    assert bench.write(x.status_return_level, 1) == 0
    assert handler.write1ByteTxRx(bench.port, 1, x.led.address, 1)[0] == sdk.COMM_RX_TIMEOUT
    assert bench.read(x.led) == 1
    handler.write1ByteTxOnly(bench.port, 1, x.status_return_level.address, 0)
    assert handler.read1ByteTxRx(bench.port, 1, x.led.address)[1] == sdk.COMM_RX_TIMEOUT
    assert handler.ping(bench.port, 1)[1] == sdk.COMM_SUCCESS


@pytest.mark.parametrize("units", [20, 50, 100])
def test_the_profile_velocity_sets_the_speed(units: int) -> None:
    bench = Bench()
    bench.write(x.position_p_gain, 2400)
    bench.write(x.torque_enable, 1)
    bench.write(x.profile_velocity, units)
    bench.write(x.goal_position, 4000)
    bench.run(0.4)
    assert bench.read(x.present_velocity) == pytest.approx(units, abs=max(3, 0.05 * units))
    assert bench.read(x.moving) == 1


def test_a_goal_without_a_profile_is_reached_and_holds() -> None:
    bench = Bench()
    bench.write(x.torque_enable, 1)
    bench.write(x.goal_position, 2600)
    bench.run(2.0)
    assert bench.read(x.present_position) == pytest.approx(2600, abs=15)
    assert bench.read(x.moving) == 0


def test_a_higher_gain_reduces_the_sag() -> None:
    sag = {}
    for gain in (640, 2400):
        bench = Bench(load_nm=0.5)
        bench.write(x.position_p_gain, gain)
        bench.write(x.torque_enable, 1)
        bench.run(1.0)
        sag[gain] = bench.read(x.present_position) - bench.read(x.goal_position)
    assert 0 < sag[2400] < 0.5 * sag[640]


def test_goal_pwm_limits_the_drive() -> None:
    bench = Bench(load_nm=1.0)
    bench.write(x.goal_pwm, 200)
    bench.write(x.torque_enable, 1)
    bench.run(0.5)
    assert abs(bench.read(x.present_pwm)) == 200
    assert abs(bench.read(x.present_load)) == 226


def test_overload_shuts_down_until_a_reboot() -> None:
    bench = Bench(load_nm=2.0)
    bench.write(x.torque_enable, 1)
    bench.run(5.0)
    assert bench.read(x.hardware_error_status) == 1 << 5
    assert bench.read(x.torque_enable) == 0
    bench.plant.load_nm[:] = [0.0]
    assert bench.write(x.torque_enable, 1) == 0x80 | 1
    handler.reboot(bench.port, 1)
    bench.run(REBOOT_S + 0.01)
    assert bench.write(x.torque_enable, 1) == 0
    assert bench.read(x.hardware_error_status) == 0


def test_packets_at_another_baud_rate_are_ignored() -> None:
    bench = Bench()
    port = SdkAdapter(Line(VirtualPort(bench.bus, bench.clock, baud=57_600), bench.clock))
    assert handler.ping(port, 1)[1] == sdk.COMM_RX_TIMEOUT


def test_servos_of_different_rated_voltages_have_separate_supplies() -> None:
    bus = VirtualDynamixelBus.of(BenchPlant((1, 2, 3)), {1: x.XL430_W250, 2: x.XL330_M288, 3: x.XM430_W350})
    bus.rig.step()
    assert [servo.firmware.voltage_v for servo in bus.servos] == [12.0, 5.0, 12.0]
    bus.servo(1).firmware.duty = bus.servo(1).firmware.current_a = 1.0
    bus.rig.step()
    assert bus.servo(2).firmware.voltage_v == 5.0
    assert bus.servo(3).firmware.voltage_v < 12.0
    assert bus.servo(2).firmware.protection.status == 0


def test_position_mode_ignores_a_large_homing_offset_and_extended_position_mode_adds_it() -> None:
    bench = Bench()
    assert bench.write(x.homing_offset, 1500) == 0
    assert bench.read(x.present_position) == 2048
    assert bench.write(x.operating_mode, x.EXTENDED_POSITION_MODE) == 0
    assert bench.read(x.present_position) == 3548
    assert bench.write(x.operating_mode, x.POSITION_MODE) == 0
    assert bench.write(x.homing_offset, -1024) == 0
    assert bench.read(x.present_position) == 1024
    assert bench.write(x.homing_offset, 1_044_480) == 4


def test_turns_are_counted_until_power_off_or_torque_on_in_position_mode() -> None:
    bench = Bench()
    assert bench.write(x.operating_mode, x.EXTENDED_POSITION_MODE) == 0
    assert bench.write(x.torque_enable, 1) == 0
    assert bench.write(x.goal_position, 5000) == 0, "extended position mode has no position limits"
    bench.run(3.0)
    assert bench.read(x.present_position) == pytest.approx(5000, abs=10)
    bench.write(x.torque_enable, 0)
    bench.write(x.torque_enable, 1)
    assert bench.read(x.present_position) == pytest.approx(5000, abs=10)
    assert handler.reboot(bench.port, 1) == (sdk.COMM_SUCCESS, 0)
    bench.run(REBOOT_S + 0.01)
    assert bench.read(x.present_position) == pytest.approx(904, abs=10)
