"""Files of servos: our calibrations and LeRobot's, passports, and the EEPROM of virtual servos."""

import json
import tempfile
from functools import cache
from pathlib import Path
from typing import Final

import yaml

from commissioning.calibrations import calibration_rows, export_calibration, import_calibration
from commissioning.passport.compare import take_passport
from commissioning.passport.file import read_passport, write_passport
from hal.robot_file.calibration_file import calibration_path
from servoloop.commands.shared.options import known_arm
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.arm_options import ServoArm
from servoloop.stack.emulator import virtual_lines
from sim_backend.eeprom import keep_eeprom
from sim_backend.mechanics.plant import BenchPlant
from tests.commissioning.test_passport import Line
from tests.mutated.arm_files import come_up
from tests.mutated.kind import SO101, Kind, files_of


def beside_robot(folder: Path) -> None:
    (folder / "robot.yaml").write_bytes(find_arm(SO101).robot.read_bytes())


def read_calibration(path: Path) -> None:
    robot = path.with_name("robot.yaml")
    known = known_arm(ServoArm(SO101, robot))
    calibration_rows(known.robot, known.joints)
    come_up(read_arm_files(find_arm(SO101), robot=robot))
    export_calibration(path.with_name("exported.json"), robot)


def good_calibration() -> list[bytes]:
    joint = {"sign": 1, "zero_counts": 2048, "homing_offset": 12, "lower_counts": 900, "upper_counts": 3200}
    joints = {one.name: {"servo_id": one.servo_id, **joint} for one in files_of(SO101).robot.joints}
    return [yaml.safe_dump({"joints": joints}).encode()]


def read_lerobot(path: Path) -> None:
    robot = path.with_name("robot.yaml")
    calibration_path(robot).unlink(missing_ok=True)
    known = known_arm(ServoArm(SO101, robot))
    import_calibration(path, robot, known.joints, known.plans)


def good_lerobot() -> list[bytes]:
    joint = {"drive_mode": 0, "homing_offset": -120}
    found = {}
    for one in files_of(SO101).robot.joints:
        half = round(0.5 * (one.limits.upper - one.limits.lower) / abs(one.units_per_count))
        found[one.name] = {"id": one.servo_id, **joint, "range_min": 2048 - half, "range_max": 2047 + half}
    return [json.dumps(found).encode()]


def read_eeprom(path: Path) -> None:
    robot = files_of(SO101).robot
    lines = virtual_lines(robot, BenchPlant([joint.servo_id for joint in robot.joints]))
    keep_eeprom(path, lines.values())


@cache
def good_eeprom() -> list[bytes]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "eeprom.yaml"
        read_eeprom(path)
        return [path.read_bytes()]


def read_servo_passport(path: Path) -> None:
    read_passport(path)


@cache
def good_passport() -> list[bytes]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "passport.yaml"
        write_passport(path, take_passport(Line().bus, joints={1: "shoulder_pan"}))
        return [path.read_bytes()]


KINDS: Final = {
    "calibration": Kind("robot.calibration.yaml", good_calibration, read_calibration, beside_robot),
    "lerobot": Kind("lerobot.json", good_lerobot, read_lerobot, beside_robot),
    "eeprom": Kind("eeprom.yaml", good_eeprom, read_eeprom),
    "passport": Kind("passport.yaml", good_passport, read_servo_passport),
}
