"""The pick-and-place job on Dynamixel servos, from the controllers to the cube, in simulated time."""

import pytest

from servoloop.simulation.stack import SimulatedStack
from servoloop.stack.robot_files import read_files
from servoloop.stack.shipped_files import CONFIG
from tests.stack.rig import BINS, UnpacedJob

LARGEST_RAD, RMS_RAD = 0.08, 0.03


@pytest.mark.parametrize("grade", BINS)
def test_cube_lands_in_its_bin(grade: str) -> None:
    rig = SimulatedStack(files=read_files(robot=CONFIG / "robot_arm_dynamixel.yaml")).up()
    job = UnpacedJob(rig, grade)
    job.run()
    rig.run(1.0)
    largest, rms = rig.trace.following_error()
    job.check()
    assert rig.loop.figures.missed == 0
    assert largest.max() < LARGEST_RAD
    assert rms.max() < RMS_RAD
    assert [servo.memory.read(70, 1) for servo in rig.bus.servos] == [b"\0"] * 7
