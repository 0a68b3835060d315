"""The virtual XL-320 with the real driver and the official SDK: its table, access rules and motion."""

import importlib
from typing import Any

import pytest

from drivers.bus.bus import Bus
from drivers.bus.sdk_adapter import SdkAdapter
from drivers.port.line import Line
from drivers.servos import x, xl320
from drivers.servos.register import Access, Register
from drivers.types import ServoFault, ServoGoal, ServoState
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.line.rig import Supply
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.servos.dynamixel.protocol2_servo import REBOOT_S
from sim_backend.servos.dynamixel.xl320_memory import FACTORY
from sim_backend.servos.dynamixel.xl320_servo import VirtualXl320Servo

# Imported by name, because the SDK has no type hints.
sdk: Any = importlib.import_module("dynamixel_sdk")
handler = sdk.Protocol2PacketHandler()
IDS = (1, 2)
START = 614
"""Half a turn, where the shafts of a bench start."""


class Bench:
    """Two servos. The second servo may be of a different model."""

    def __init__(self, second: x.XModel | None = None, volts: float | None = None) -> None:
        self.models = {1: xl320.XL320, 2: second or xl320.XL320}
        self.clock = SimulatedClock(10.0)
        self.plant = BenchPlant(IDS)
        supply = Supply(volts, 0.0) if volts else None
        self.line = VirtualDynamixelBus.of(self.plant, self.models, supply=supply)
        port = VirtualPort(self.line, self.clock)
        self.sdk = SdkAdapter(Line(port, self.clock))
        self.bus = Bus(port, self.clock, self.models)

    def hold(self, position: int = START) -> None:
        for servo_id in IDS:
            self.bus.identify(servo_id, self.models[servo_id])
        self.bus.write_goals({1: ServoGoal(position)})
        self.bus.torque_on(1)

    def run(self, seconds: float) -> ServoState | ServoFault:
        self.clock.sleep_until(self.clock.now() + seconds)
        return self.bus.read_states(IDS, self.clock.now() + 0.05)[1]

    def write(self, register: Register, value: int) -> int:
        """Return the error number."""
        data = list(register.encode(value, "little"))
        result, error = handler.writeTxRx(self.sdk, 1, register.address, register.size, data)
        assert result == sdk.COMM_SUCCESS
        return int(error) & 0x7F


def test_factory_values_and_access_of_every_register() -> None:
    bench = Bench()
    for register in xl320.REGISTERS:
        if register.access is Access.READ:
            assert bench.write(register, 0) == 7
    servo = VirtualXl320Servo(5)
    assert servo.baud == 1_000_000
    assert servo.memory.read(0, 2) == (350).to_bytes(2, "little")
    for register, value in FACTORY.items():
        assert servo.memory.get(register) == (5 if register == xl320.servo_id else value)


def test_ping_and_a_read_beyond_the_table() -> None:
    bench = Bench()
    assert handler.ping(bench.sdk, 1) == (350, sdk.COMM_SUCCESS, 0)
    assert handler.readTxRx(bench.sdk, 1, 51, 2)[1:] == (sdk.COMM_SUCCESS, 0)
    assert handler.readTxRx(bench.sdk, 1, 52, 2)[2] == 7


@pytest.mark.parametrize(
    ("register", "value", "error"),
    [
        (xl320.goal_position, 1024, 6),
        (xl320.moving_speed, 2048, 4),
        (xl320.torque_enable, 2, 4),
        (xl320.control_mode, 3, 4),
        (xl320.led, 8, 4),
        (xl320.led, 7, 0),
    ],
)
def test_values_beyond_a_range_are_refused(register: Register, value: int, error: int) -> None:
    assert Bench().write(register, value) == error


def test_eeprom_is_locked_under_torque_and_angle_limits_restrict_the_goal() -> None:
    bench = Bench()
    assert bench.write(xl320.ccw_angle_limit, 700) == 0
    assert bench.write(xl320.torque_enable, 1) == 0
    assert bench.write(xl320.ccw_angle_limit, 800) == 7
    assert (bench.write(xl320.goal_position, 701), bench.write(xl320.goal_position, 700)) == (6, 0)


def test_a_goal_is_reached_within_friction_and_the_speed_has_a_sign() -> None:
    bench = Bench()
    bench.hold()
    bench.bus.write_goals({1: ServoGoal(START + 100, 100)})
    on_the_way = bench.run(0.5)
    assert isinstance(on_the_way, ServoState)
    assert START < on_the_way.position_counts < START + 90
    assert 50 < on_the_way.velocity_counts_s < 150
    arrived = bench.run(2.0)
    assert isinstance(arrived, ServoState)
    assert START + 100 - 13 <= arrived.position_counts <= START + 100
    bench.bus.write_goals({1: ServoGoal(START, 100)})
    back = bench.run(0.6)
    assert isinstance(back, ServoState)
    assert back.velocity_counts_s < -50


def test_more_gain_reduces_the_error_and_the_torque_limit_clips_the_drive() -> None:
    bench = Bench()
    bench.hold(START + 60)
    soft = bench.run(2.0)
    assert bench.write(xl320.p_gain, 200) == 0
    stiff = bench.run(2.0)
    assert isinstance(soft, ServoState) and isinstance(stiff, ServoState)
    assert START + 60 - stiff.position_counts < (START + 60 - soft.position_counts) / 3
    bench.plant.load_nm[0] = -1.0
    assert bench.write(xl320.torque_limit, 300) == 0
    pushing = bench.run(0.3)
    assert isinstance(pushing, ServoState)
    assert pushing.load == pytest.approx(300 / 1023, abs=0.002)


def test_a_stall_shuts_the_servo_down_until_a_reboot() -> None:
    bench = Bench()
    bench.hold()
    bench.plant.load_nm[0] = -1.0
    stalled = bench.run(5.0)
    assert isinstance(stalled, ServoState)
    assert stalled.alarms == ("overload",)
    assert bench.bus.read(1, xl320.torque_limit) == 0
    assert bench.write(xl320.torque_enable, 1) == 1
    assert handler.reboot(bench.sdk, 1)[0] == sdk.COMM_SUCCESS
    assert handler.ping(bench.sdk, 1)[1] == sdk.COMM_RX_TIMEOUT
    bench.plant.load_nm[0] = 0.0
    bench.run(REBOOT_S)
    fresh = bench.run(0.1)
    assert isinstance(fresh, ServoState)
    assert fresh.alarms == ()
    assert bench.bus.read(1, xl320.torque_limit) == 1023


def test_low_voltage_is_reported_as_an_alarm() -> None:
    bench = Bench(volts=5.0)
    state = bench.run(0.1)
    assert isinstance(state, ServoState)
    assert (state.alarms, state.voltage_v) == (("voltage",), pytest.approx(5.0))


def test_an_x_servo_and_an_xl320_share_one_line() -> None:
    bench = Bench(x.XL430_W250)
    bench.hold()
    states = bench.bus.read_states(IDS, bench.clock.now() + 0.05)
    assert [type(state) for state in states.values()] == [ServoState, ServoState]
    assert isinstance(states[2], ServoState)
    assert states[2].position_counts == 2048
