"""A calibration is stored in the file and then in the servos, and is verified with a slow motion."""

import errno
import itertools
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from commissioning.calibrate.result import JointCalibration
from commissioning.calibrate.run import check
from commissioning.calibrate.store import restart, store
from commissioning.commissioning_errors import CalibrationError
from commissioning.slow_arm import FASTEST_RAD_S, SlowArm
from drivers.driver_errors import DriverError, PortLost, ServoError
from drivers.eeprom import OPEN, EepromError
from drivers.servos import sts, x
from drivers.servos.catalog import series_of
from drivers.servos.register import ServoModel
from hal.robot_file.calibration_file import calibration_path, load_calibration
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.robot_files import read_files
from servoloop.stack.shipped_files import ARMS, CONFIG
from tests.commissioning.arm import JOINTS, UnalignedArm
from tests.commissioning.interrupted import Interrupted

TURNED_SEED = 3
"""Seed of an arm with some encoder seams within the travel."""


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    path = tmp_path / "robot.yaml"
    path.write_text((CONFIG / "robot_arm.yaml").read_text())
    return path


def test_a_calibrated_arm_reaches_its_goals(robot: Path) -> None:
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


def test_a_blocked_joint_fails_the_motion_test_and_torque_is_released(robot: Path) -> None:
    arm = UnalignedArm(TURNED_SEED)
    store(robot, arm.bus, JOINTS, arm.as_mounted(), arm.clock)
    joints = read_files(robot=robot).robot.joints
    arm.hand.release()
    arm.hand.hold("joint4")
    in_the_way = pytest.raises(CalibrationError, match=r"joint4 .*something is in its way")
    with in_the_way, SlowArm(lambda: arm.open_bus(joints), joints, arm.clock) as move:
        check(move, lambda text: None)
    assert not any(servo.memory.get(sts.torque_enable) for servo in arm.line.servos)


def test_the_previous_calibration_is_kept(robot: Path) -> None:
    arm = UnalignedArm(TURNED_SEED)
    made = arm.as_mounted()
    store(robot, arm.bus, JOINTS, made, arm.clock)
    first = calibration_path(robot).read_text()
    store(robot, arm.bus, JOINTS, made, arm.clock)
    assert calibration_path(robot).with_name("robot.calibration.yaml.1").read_text() == first
    assert not list(robot.parent.glob("*.part"))


def test_joints_on_other_buses_keep_their_calibration(robot: Path) -> None:
    arm = UnalignedArm(TURNED_SEED)
    made = arm.as_mounted()
    store(robot, arm.bus, JOINTS, made, arm.clock)
    before = load_calibration(robot)
    assert before is not None
    some, others = JOINTS[:2], [joint.name for joint in JOINTS[2:]]
    turned = {**made, some[0].name: replace(made[some[0].name], zero_counts=made[some[0].name].zero_counts + 5)}
    store(robot, arm.bus, some, turned, arm.clock, others)
    after = load_calibration(robot)
    assert after is not None and set(after.joints) == set(before.joints)
    assert {name: after.joints[name] for name in others} == {name: before.joints[name] for name in others}
    assert after.joints[some[0].name] != before.joints[some[0].name]


def test_an_arm_with_a_half_stored_calibration_refuses_to_start(robot: Path) -> None:
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


def test_repeated_failures_keep_the_last_complete_calibration(robot: Path) -> None:
    arm = UnalignedArm(TURNED_SEED)
    made, path = arm.as_mounted(), calibration_path(robot)
    store(robot, arm.bus, JOINTS, made, arm.clock)
    good = path.read_text()
    moved = {name: replace(one, homing_offset=(one.homing_offset or 0) + 1) for name, one in made.items()}
    arm.line.faults.silence(4)
    with pytest.raises(ServoError, match="servo 4") as failed:
        store(robot, arm.bus, JOINTS, moved, arm.clock)
    (note,) = [text for text in failed.value.__notes__ if str(path) in text]
    assert "in the servos of joint1, joint2, joint3, but not yet in those of joint4, joint5" in note
    arm.line.faults.restore(4)
    for _ in range(2):
        with pytest.raises(CalibrationError, match="outside its travel"):
            store(robot, arm.bus, JOINTS, {**moved, "joint2": replace(moved["joint2"], upper_counts=0)}, arm.clock)
        assert path.with_name("robot.calibration.yaml.1").read_text() == good
    store(robot, arm.bus, JOINTS, moved, arm.clock)
    assert path.with_name("robot.calibration.yaml.1").read_text() == good
    assert path.read_text().splitlines()[0] == good.splitlines()[0]


def test_a_failed_file_write_is_reported_with_the_measurements(robot: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    arm = UnalignedArm(TURNED_SEED)
    monkeypatch.setattr("os.fsync", _no_room)
    with pytest.raises(CalibrationError, match=r"cannot write .*: no room") as failed:
        store(robot, arm.bus, JOINTS, arm.as_mounted(), arm.clock)
    assert "zero_counts" in failed.value.__notes__[0] and "previous" not in str(failed.value)
    calibration_path(robot).write_text("joints: {}")
    with pytest.raises(CalibrationError, match=r"no room\. The previous file is unchanged"):
        store(robot, arm.bus, JOINTS, arm.as_mounted(), arm.clock)
    assert not any(servo.memory.get(sts.homing_offset) for servo in arm.line.servos)


def _no_room(fd: int) -> None:
    raise OSError(errno.ENOSPC, "no room")


def test_nothing_is_written_to_a_servo_under_torque(robot: Path) -> None:
    arm = UnalignedArm(TURNED_SEED)
    made = arm.as_mounted()
    for servo in arm.line.servos:
        servo.memory.put(sts.torque_enable, 1)
    with pytest.raises(EepromError, match="the torque of the servo is enabled"):
        store(robot, arm.bus, JOINTS, made, arm.clock)
    assert not any(servo.memory.get(sts.homing_offset) for servo in arm.line.servos)


def test_dynamixel_seams_are_moved_in_extended_position_mode(tmp_path: Path) -> None:
    shutil.copytree(ARMS / "koch", tmp_path / "koch")
    arm, robot = UnalignedArm(2, name="koch"), tmp_path / "koch" / "robot.yaml"
    for servo in arm.line.servos:
        servo.memory.save(x.homing_offset, 1500)  # position mode ignores this offset
    made = arm.as_mounted()
    crossing = [name for name, one in made.items() if one.extended]
    assert crossing and crossing != list(made), "this arm has the seam of some of its servos within their travel"
    changes = store(robot, arm.bus, arm.joints, made, arm.clock)
    assert [name for name, done in changes.items() if "operating_mode 3 to 4" in map(str, done)] == crossing
    joints = read_arm_files(find_arm(str(tmp_path / "koch"))).robot.joints
    for servo in arm.line.servos:
        servo.power_cycle()
    arm.hand.release()
    with SlowArm(lambda: arm.open_bus(joints), joints, arm.clock) as move:
        assert move.state.position == pytest.approx(arm.world.position(), abs=0.02)
        check(move, lambda text: None)
    arm.line.servo(1).memory.save(x.operating_mode, 7 - arm.line.servo(1).memory.get(x.operating_mode))
    refused = pytest.raises(DriverError, match=r"servo 1: is in operating mode (3: set it to 4 \(ext|4: set it to 3)")
    with refused, SlowArm(lambda: arm.open_bus(joints), joints, arm.clock):
        pass


@pytest.mark.parametrize(
    "model", [pytest.param(sts.STS3215, id="sts"), pytest.param(x.XL430_W250, id="x", marks=pytest.mark.slow)]
)
def test_a_servo_may_be_silent_for_a_moment_while_a_calibration_is_stored(robot: Path, model: ServoModel) -> None:
    made = JointCalibration(1, 2048, 300, 100, 4000, extended=model is x.XL430_W250)
    for packet in itertools.count():
        bench = Interrupted(model)
        bench.silence_at(packet)
        store(robot, bench.bus, bench.joints, {joint.name: made for joint in bench.joints}, bench.clock)
        offset = next(one for one in series_of(model).registers if one.name == "homing_offset")
        assert [servo.memory.get(offset) for servo in bench.line.servos] == [300] * len(bench.joints)
        if bench.packets <= packet:
            break


def test_a_silent_servo_does_not_prevent_the_restart_of_the_others() -> None:
    bench = Interrupted(x.XL430_W250)
    for servo in bench.line.servos:
        servo.memory.put(x.torque_enable, 1)
    bench.silence(0.0, 100.0)
    with pytest.raises(ServoError, match="servo 2"):
        restart(bench.bus, bench.joints, bench.clock)
    assert [servo.memory.get(x.torque_enable) for servo in bench.line.servos] == [0, 1, 0]
