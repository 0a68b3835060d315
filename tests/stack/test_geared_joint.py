"""A virtual arm whose joint has a gear in the URDF reaches its commands."""

import math
from dataclasses import replace
from pathlib import Path

import pytest

from drivers.servos import sts
from servoloop.simulation.stack import SimulatedStack
from servoloop.stack.arm_folders import find_arm, read_arm_files

GEAR = """<transmission name="gear"><plugin>transmission_interface/SimpleTransmission</plugin>
<actuator name="motor"/><joint name="wrist_roll"><mechanical_reduction>-0.5</mechanical_reduction></joint>
</transmission></ros2_control>"""


def test_a_geared_joint_reaches_its_command(tmp_path: Path) -> None:
    arm = find_arm("so101")
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(arm.urdf.read_text().replace("</ros2_control>", GEAR))
    files = read_arm_files(arm, urdf, robot=arm.robot)
    stack = SimulatedStack(files=replace(files, folder=None)).up()
    stack.run(0.1)
    handle = stack.go([*stack.loop.within_limits[:4].tolist(), 0.8])
    stack.run(4.0, lambda: handle.done)
    stack.run(0.5)
    assert stack.trace.actual[-1][4] == pytest.approx(0.8, abs=0.06)
    servo = stack.bus.servos[4]
    assert servo.memory.get(sts.servo_id) == 5
    assert servo.memory.get(sts.present_position) == pytest.approx(2047 - 0.4 * 4096 / math.tau, abs=40)
