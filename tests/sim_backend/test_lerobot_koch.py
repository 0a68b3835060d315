"""The servos of a Koch with LeRobot's settings: the calibration, modes 4 and 5, and group reads and writes of the SDK.

The steps are those of ``KochFollower.calibrate`` and ``configure`` in LeRobot 0.6.1. ``tests/peers/test_lerobot.py``
runs LeRobot itself.
"""

from typing import Any

import pytest

from drivers.bus.sdk_adapter import SdkAdapter
from drivers.port.line import Line
from drivers.servos import x
from drivers.servos.register import Register
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.servos.dynamixel.modes import CURRENT_POSITION
from sim_backend.servos.dynamixel.protocol2_servo import REBOOT_S
from tests.sim_backend.dynamixel_bench import handler, sdk

KOCH = {i: x.XL430_W250 if i < 3 else x.XL330_M288 for i in range(1, 7)}
GRIPPER, ELBOW = 6, 3
MIDDLE = 2047
STARTS_RAD = (0.4, -2.0, 5.1, 2.9, -0.3, 1.2)


class Koch:
    """Six servos on shafts, set up as LeRobot does."""

    def __init__(self) -> None:
        self.clock = SimulatedClock()
        plant = BenchPlant(tuple(KOCH))
        plant.place(STARTS_RAD)
        self.line = VirtualDynamixelBus.of(plant, KOCH)
        self.line.advance(self.clock.now() + 0.01)
        self.port = SdkAdapter(Line(VirtualPort(self.line, self.clock), self.clock))

    def run(self, seconds: float) -> None:
        self.clock.sleep_until(self.clock.now() + seconds)
        self.line.advance(self.clock.now())

    def write(self, servo_id: int, register: Register, value: int) -> None:
        data = list(register.encode(value, "little"))
        assert handler.writeTxRx(self.port, servo_id, register.address, register.size, data) == (sdk.COMM_SUCCESS, 0)

    def sync_read(self, register: Register) -> dict[int, int]:
        reader: Any = sdk.GroupSyncRead(self.port, handler, register.address, register.size)
        assert all(reader.addParam(i) for i in KOCH)
        assert reader.txRxPacket() == sdk.COMM_SUCCESS
        values = {i: reader.getData(i, register.address, register.size) for i in KOCH}
        return {i: register.decode(value.to_bytes(register.size, "little"), "little") for i, value in values.items()}

    def sync_write(self, register: Register, values: dict[int, int]) -> None:
        writer: Any = sdk.GroupSyncWrite(self.port, handler, register.address, register.size)
        assert all(writer.addParam(i, list(register.encode(value, "little"))) for i, value in values.items())
        assert writer.txPacket() == sdk.COMM_SUCCESS

    def calibrate(self) -> dict[int, int]:
        """Make the current pose the middle position of all servos. Return the homing offsets."""
        for servo_id in KOCH:
            self.write(servo_id, x.torque_enable, 0)
            self.write(servo_id, x.operating_mode, x.EXTENDED_POSITION_MODE)
            self.write(servo_id, x.homing_offset, 0)
        offsets = {i: MIDDLE - position for i, position in self.sync_read(x.present_position).items()}
        for servo_id, offset in offsets.items():
            self.write(servo_id, x.homing_offset, offset)
            self.write(servo_id, x.min_position_limit, 700)
            self.write(servo_id, x.max_position_limit, 3400)
        return offsets

    def configure(self) -> None:
        """Set modes and gains, and enable the torque."""
        for servo_id in KOCH:
            self.write(servo_id, x.torque_enable, 0)
            self.write(servo_id, x.return_delay, 0)
            mode = CURRENT_POSITION if servo_id == GRIPPER else x.EXTENDED_POSITION_MODE
            self.write(servo_id, x.operating_mode, mode)
        for register, value in ((x.position_p_gain, 1500), (x.position_i_gain, 0), (x.position_d_gain, 600)):
            self.write(ELBOW, register, value)
        for servo_id in KOCH:
            self.write(servo_id, x.torque_enable, 1)


def test_the_calibration_values_are_kept_and_the_pose_is_the_middle() -> None:
    koch = Koch()
    offsets = koch.calibrate()
    assert max(map(abs, offsets.values())) > x.LARGEST_OFFSET_OF_POSITION_MODE
    assert koch.sync_read(x.present_position) == dict.fromkeys(KOCH, MIDDLE)
    for servo_id in KOCH:
        handler.reboot(koch.port, servo_id)
        koch.run(REBOOT_S + 0.01)
    assert koch.sync_read(x.homing_offset) == offsets
    assert koch.sync_read(x.min_position_limit) == dict.fromkeys(KOCH, 700)
    assert koch.sync_read(x.max_position_limit) == dict.fromkeys(KOCH, 3400)


def test_every_joint_reaches_its_goals() -> None:
    koch = Koch()
    koch.calibrate()
    koch.configure()
    for shift in (500, -700, 0):
        goals = {i: MIDDLE + shift + 10 * i for i in KOCH}
        koch.sync_write(x.goal_position, goals)
        koch.run(2.5)
        assert koch.sync_read(x.present_position) == pytest.approx(goals, abs=40)


def test_the_gripper_closes_with_its_goal_current() -> None:
    koch = Koch()
    koch.calibrate()
    koch.configure()
    koch.write(GRIPPER, x.goal_current, 100)
    koch.line.rig.plant.load_nm[GRIPPER - 1] = 0.2  # type: ignore[attr-defined]
    koch.sync_write(x.goal_position, {GRIPPER: MIDDLE + 200})
    koch.run(0.05)
    assert abs(koch.sync_read(x.present_current)[GRIPPER]) <= 101
