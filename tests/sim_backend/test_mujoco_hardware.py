"""The arm in MuJoCo as hardware: how far it sinks under its weight."""

import numpy as np
import pytest

from hal.types import FloatArray, JointCommand
from servoloop.arms.folder import find_arm, read_arm_files
from sim_backend.clock import SimulatedClock
from sim_backend.scene.mujoco_hardware import MujocoHardware
from sim_backend.scene.world import World

PERIOD_S = 0.02
SAG = 0.006
"""Maximum error of a joint at rest that servos with gravity compensation leave, rad or m."""
POSES = {
    "robot_arm": ([0, -1.5, 0, 0, 0, 0, 0], [0.5, -0.9, -0.6, 0.4, -0.3, 1, 0.03]),
    "so101": ([0, 0.6, 0, 0, 0, 0], [0.5, 0.9, -0.6, 0.4, -0.3, 1]),
    "so100": ([0, 0.6, 0, 0, 0, 0], [0.5, 0.9, -0.6, 0.4, -0.3, 1]),
    "koch": ([0, -0.6, 0, 0, 0, -0.5], [0.5, -0.9, 0.6, 0.4, -0.3, -1]),
}
"""By arm: one pose in which it is stretched out, and another one."""


def followed(hardware: MujocoHardware, clock: SimulatedClock, goal: FloatArray) -> FloatArray:
    """Where the arm is a second after a straight line of two seconds to `goal`."""
    begin = hardware.read().position
    for share in [*np.linspace(0.0, 1.0, 100), *[1.0] * 50]:
        hardware.write(JointCommand(begin + (goal - begin) * share, PERIOD_S))
        clock.sleep_until(clock.now() + PERIOD_S)
        position = hardware.read().position
    return position


@pytest.mark.parametrize("name", POSES)
def test_the_weight_moves_an_arm_at_rest_by_no_more_than_servos_leave(name: str) -> None:
    files, clock = read_arm_files(find_arm(name)), SimulatedClock()
    hardware = MujocoHardware("arm", files.robot.joints, World(files.scene), clock)
    hardware.configure()
    hardware.activate()
    for pose in POSES[name]:
        goal = np.array(pose, float)
        assert np.abs(followed(hardware, clock, goal) - goal).max() < SAG
