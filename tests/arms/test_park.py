"""Each arm is stable in the pose in which it is released."""

import numpy as np
import pytest

from servoloop.simulation.stack import SimulatedStack
from servoloop.stack.arm_folders import find_arm, read_arm_files
from sim_backend.buses.build import Build

ARMS = ("robot_arm", "robot_arm_dynamixel", "so101", "so101_12v", "so101_leader", "so100", "koch")
LATER_S = 6.0
FALLEN_RAD = 0.2
OFF_RAD = 0.02
"""Distance of each joint from its park pose when the arm is released, in rad of the shaft."""


@pytest.mark.parametrize(("name", "backlash_deg"), [(ARMS[0], 0.0), *((name, 1.0) for name in ARMS)])
def test_parked_and_released_arm_stays_in_place(name: str, backlash_deg: float) -> None:
    files = read_arm_files(find_arm(name))
    park = files.robot.file.park
    assert park is not None, f"{name} is released in its current pose"
    start = [park.pose.get(joint.name, 0.0) - OFF_RAD * joint.transmission for joint in files.robot.joints]
    rig = SimulatedStack(files=files, start=start, build=Build(backlash_deg, 1))
    before = rig.world.position()
    for line in rig.lines.values():
        line.advance(LATER_S)
    fallen = np.abs(rig.world.position() - before)
    assert (fallen < FALLEN_RAD).all(), dict(zip(rig.world.joints, fallen.round(3), strict=True))
