"""Storing and verifying a calibration: file before servos, offsets behind their lock, and a slow move."""

from pathlib import Path

import pytest

from calibration.eeprom import OPEN, EepromError
from commissioning.calibrate.result import CalibrationError
from commissioning.calibrate.store import store
from commissioning.calibrate.verify import check
from commissioning.slow_arm import FASTEST_RAD_S, SlowArm
from drivers.errors import DriverError, PortLost
from drivers.servos import sts
from hal.robot_file.calibration_file import calibration_path
from servoloop.files import CONFIG, read_files
from tests.commissioning.arm import JOINTS, UnalignedArm

TURNED_SEED = 3
"""An arm that has the seam of some of its servos within their travel."""


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    path = tmp_path / "robot.yaml"
    path.write_text((CONFIG / "robot_arm.yaml").read_text())
    return path


def test_the_whole_way_from_an_unaligned_arm_to_one_that_goes_where_it_is_sent(robot: Path) -> None:
    arm = UnalignedArm(TURNED_SEED)
    made = arm.as_mounted()
    changes = store(robot, arm.bus, JOINTS, made, arm.clock)
    assert any(changes.values()), "this arm has a seam in its way"
    assert all(servo.memory.get(sts.lock) != OPEN for servo in arm.line.servos)
    joints = read_files(robot=robot).robot.joints
    assert {joint.name: joint.sign for joint in joints} == {one.joint: one.sign for one in arm.couplings}
    before = arm.world.position()
    arm.hand.release()
    said: list[str] = []
    with SlowArm(lambda: arm.open_bus(joints), joints, arm.clock) as move:
        arm.fastest_rad_s = 0.0
        check(move, said.append)
        assert arm.world.position() == pytest.approx(before, abs=0.12), "soft servos sag"
        assert 0.2 < arm.fastest_rad_s < 2.0 * FASTEST_RAD_S
    assert len(said) == len(joints)
    assert not any(servo.memory.get(sts.torque_enable) for servo in arm.line.servos)


def test_a_joint_that_is_held_does_not_pass_and_the_arm_is_limp_again(robot: Path) -> None:
    arm = UnalignedArm(TURNED_SEED)
    store(robot, arm.bus, JOINTS, arm.as_mounted(), arm.clock)
    joints = read_files(robot=robot).robot.joints
    arm.hand.release()
    arm.hand.hold("joint4")
    in_the_way = pytest.raises(CalibrationError, match=r"joint4 .*is something in its way")
    with in_the_way, SlowArm(lambda: arm.open_bus(joints), joints, arm.clock) as move:
        check(move, lambda text: None)
    assert not any(servo.memory.get(sts.torque_enable) for servo in arm.line.servos)


def test_the_former_calibration_is_kept(robot: Path) -> None:
    arm = UnalignedArm(TURNED_SEED)
    made = arm.as_mounted()
    store(robot, arm.bus, JOINTS, made, arm.clock)
    first = calibration_path(robot).read_text()
    store(robot, arm.bus, JOINTS, made, arm.clock)
    assert calibration_path(robot).with_name("robot.calibration.yaml.1").read_text() == first
    assert not list(robot.parent.glob("*.part"))


def test_a_line_that_is_lost_in_between_leaves_an_arm_that_does_not_come_up(robot: Path) -> None:
    arm = UnalignedArm(TURNED_SEED)
    made = arm.as_mounted()
    writes = 0
    write = arm.port.write

    def cut(data: bytes) -> None:
        nonlocal writes
        writes += data[4] == 3
        if writes > 1:
            arm.port.unplug()
        write(data)

    arm.port.write = cut  # type: ignore[method-assign]
    with pytest.raises(PortLost):
        store(robot, arm.bus, JOINTS, made, arm.clock)
    joints = read_files(robot=robot).robot.joints
    refused = pytest.raises(DriverError, match="was calibrated with")
    with refused, SlowArm(lambda: arm.open_bus(joints), joints, arm.clock):
        pass


def test_nothing_is_written_to_a_servo_under_torque(robot: Path) -> None:
    arm = UnalignedArm(TURNED_SEED)
    made = arm.as_mounted()
    for servo in arm.line.servos:
        servo.memory.put(sts.torque_enable, 1)
    with pytest.raises(EepromError, match="switch it off first"):
        store(robot, arm.bus, JOINTS, made, arm.clock)
    assert not any(servo.memory.get(sts.homing_offset) for servo in arm.line.servos)
