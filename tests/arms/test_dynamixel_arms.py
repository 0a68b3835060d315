"""Dynamixel arms with random zeros are calibrated and sort cubes, in simulated time.

Each servo has been turned by two turns beforehand, and one servo is repeatedly silent for 0.2 s.
"""

from math import tau
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
import yaml

from commissioning.calibrate.run import JointsToCalibrate, calibrate
from commissioning.calibrate.store import save
from drivers.clock import Clock
from drivers.servos import x
from servoloop.simulation.job import run_job
from servoloop.simulation.stack import SimulatedStack
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.pick_place import load_pick_place
from sim_backend.buses.build import Build
from sim_backend.line.line import ServoLine
from tests.commissioning.arm import UnalignedArm
from tests.commissioning.test_calibrate_run import Owner

SEED: Final = 2
"""Seed of arms in which the encoder seams of some servos are within the travel of their joints."""
BACKLASH_DEG: Final = 1.0
OLD: Final = 44
"""Firmware version without fast sync read."""
SILENT_S, EVERY_S = 0.2, 2.0
TURNS: Final = 2
START_S: Final = 5.0
ACTIVATED_S: Final = 2.5
ELBOW: Final = 3

Line = ServoLine[Any]


def robot_file(folder: Path, name: str, firmware: int | None) -> Path:
    """Write the robot file of an arm whose servos have this firmware version."""
    content = yaml.safe_load(find_arm(name).robot.read_text())
    for joint in content["joints"].values() if firmware else ():
        joint["firmware"] = firmware
    path = folder / "robot.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


def turn_by_hand(line: Line, clock: Clock) -> None:
    """Turn each limp servo by two turns. Neighbors turn in opposite directions."""
    line.advance(clock.now())
    for number in range(len(line.servos)):
        line.rig.plant.slip(number, (-1) ** number * TURNS * tau)
    clock.sleep_until(clock.now() + 0.1)
    line.advance(clock.now())


def interrupt(line: Line, clock: Clock, servo_id: int) -> None:
    """Silence a servo for 0.2 s repeatedly."""
    line.faults.on_instruction.append(lambda heard: heard != servo_id or clock.now() % EVERY_S >= SILENT_S)


def calibrate_by_hand(robot: Path, name: str, silent: int) -> None:
    """Calibrate an arm by hand, and test its joints under torque."""
    arm = UnalignedArm(SEED, BACKLASH_DEG, name, robot=robot)
    turn_by_hand(arm.line, arm.clock)
    interrupt(arm.line, arm.clock, silent)
    plans = arm.plan.joints
    outcome = calibrate(
        JointsToCalibrate(robot, arm.joints, plans), lambda: arm.open_bus(arm.joints), Owner(arm, plans), arm.clock
    )
    assert outcome.tried and [one.doubt for one in outcome.differences] == [""] * len(arm.joints)
    assert 0 < sum(one.made.extended for one in outcome.differences) < len(arm.joints)


def started(robot: Path, name: str, silent: int) -> SimulatedStack:
    """Start the stack of a calibrated arm whose servos are mounted as during the calibration."""
    build = Build(BACKLASH_DEG, practice_seed=SEED)
    rig = SimulatedStack(files=read_arm_files(find_arm(name), robot=robot), build=build)
    turn_by_hand(rig.bus, rig.clock)
    for now_s in (0.5 * START_S, START_S):
        rig.bus.advance(now_s)
    rig.clock.sleep_until(START_S)
    interrupt(rig.bus, rig.clock, silent)
    rig.up()
    rig.run(ACTIVATED_S)
    return rig


def test_a_koch_with_old_firmware_starts_after_two_turns_by_hand(tmp_path: Path) -> None:
    robot = robot_file(tmp_path, "koch", OLD)
    arm = UnalignedArm(SEED, name="koch", robot=robot)
    save(robot, {joint.name: (joint.servo_id, arm.as_mounted()[joint.name]) for joint in arm.joints})
    rig = started(robot, "koch", ELBOW)
    assert [servo.memory.get(x.firmware_version) for servo in rig.bus.servos] == [OLD] * len(arm.joints)
    before = rig.world.position()
    rig.run(1.0)
    assert np.abs(rig.world.position() - before).max() < 0.01
    assert rig.loop.figures.missed == 0


@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.parametrize(
    ("name", "firmware", "silent"),
    [
        ("koch", None, 1),
        ("koch", OLD, ELBOW),
        ("robot_arm_dynamixel", None, 4),
        ("robot_arm_dynamixel", OLD, 2),
    ],
)
def test_an_arm_is_calibrated_from_random_zeros_and_sorts_three_cubes(
    tmp_path: Path, name: str, firmware: int | None, silent: int
) -> None:
    robot = robot_file(tmp_path, name, firmware)
    calibrate_by_hand(robot, name, silent)
    rig = started(robot, name, silent)
    settings = load_pick_place(find_arm(name).pick_place).settings()
    records = [run_job(rig, settings, grade) for grade in "ABC"]
    assert [record.bin for record in records] == ["A", "B", "C"], [record.message for record in records]
    assert all(record.success for record in records)
    assert rig.loop.figures.missed == 0
