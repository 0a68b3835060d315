"""The arm in MuJoCo as a hardware component: its initial pose, and how far it sinks under its weight."""

import numpy as np
import pytest

from hal.components.component_lifecycle import configure_all
from hal.types import FloatArray, JointCommand
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.hardware import HardwareKind, build
from servoloop.stack.robot_files import read_files
from servoloop.stack.virtual_lines import VirtualLines
from sim_backend.buses.build import Build
from sim_backend.clock import SimulatedClock
from sim_backend.scene.mujoco_hardware import MujocoHardware
from sim_backend.scene.world import World

PERIOD_S = 0.02
SAG = 0.006
"""Maximum error of a joint at rest in an arm with servos and gravity compensation, in rad or m."""
POSES = {
    "robot_arm": ([0, -1.5, 0, 0, 0, 0, 0], [0.5, -0.9, -0.6, 0.4, -0.3, 1, 0.03]),
    "so101": ([0, 0.6, 0, 0, 0, 0], [0.5, 0.9, -0.6, 0.4, -0.3, 1]),
    "so100": ([0, 0.6, 0, 0, 0, 0], [0.5, 0.9, -0.6, 0.4, -0.3, 1]),
    "koch": ([0, -0.6, 0, 0, 0, -0.5], [0.5, -0.9, 0.6, 0.4, -0.3, -1]),
}
"""Two poses for each arm, one of which is stretched out."""


def followed(hardware: MujocoHardware, clock: SimulatedClock, goal: FloatArray) -> FloatArray:
    """Return the positions one second after a straight motion of two seconds to `goal`."""
    begin = hardware.read().position
    for share in [*np.linspace(0.0, 1.0, 100), *[1.0] * 50]:
        hardware.write(JointCommand(begin + (goal - begin) * share, PERIOD_S))
        clock.sleep_until(clock.now() + PERIOD_S)
        position = hardware.read().position
    return position


@pytest.mark.parametrize("name", POSES)
def test_an_arm_at_rest_sinks_no_more_than_with_servos(name: str) -> None:
    files, clock = read_arm_files(find_arm(name)), SimulatedClock()
    hardware = MujocoHardware("arm", files.robot.joints, World(files.scene), clock)
    hardware.configure()
    hardware.activate()
    for pose in POSES[name]:
        goal = np.array(pose, float)
        assert np.abs(followed(hardware, clock, goal) - goal).max() < SAG


def test_an_arm_without_rest_pose_does_not_sink_before_torque_is_enabled() -> None:
    """MoveIt plans from this pose. Both kinds of hardware are checked two seconds after the start, without torque."""
    files, clock = read_files(), SimulatedClock()
    ready = World(files.scene).ready
    lines = VirtualLines(files, Build(backlash_deg=1.0, seed=1))
    lines.advance(0.0)
    lines.advance(2.0)
    assert np.abs(lines.world.position() - ready).max() == 0.0
    in_mujoco = build(HardwareKind.MUJOCO, files, {}, clock).hardware
    configure_all(in_mujoco, [], keep_alive=False)
    for _ in range(100):
        clock.sleep_until(clock.now() + PERIOD_S)
        position = in_mujoco.read().position
    assert np.abs(position - ready).max() == 0.0
