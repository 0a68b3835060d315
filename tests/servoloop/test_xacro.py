"""``--urdf FILE.xacro`` with ``--xacro-arg``, and the options with which other processes read the same robot."""

from pathlib import Path

import pytest

from drivers.driver_errors import DriverError
from hal.hal_errors import DescriptionError
from servoloop.stack.arm_folders import find_arm
from servoloop.stack.arm_options import ControlledArm, xacro_arguments


def test_arguments_reach_the_urdf_and_other_processes(tmp_path: Path) -> None:
    pytest.importorskip("xacro")
    folder = find_arm("so101").folder
    text = (folder / "arm.urdf").read_text().replace('name="wrist_roll"', 'name="$(arg roll)"')
    text = text.replace("<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" ', 1)
    first = text.index(">", text.index("<robot ")) + 1
    urdf = tmp_path / "arm.urdf.xacro"
    urdf.write_text(f'{text[:first]}<xacro:arg name="roll" default="turn"/>{text[first:]}')
    arm = ControlledArm("so101", urdf=urdf, robot=folder / "robot.yaml", xacro_arg=["roll:=wrist_roll"])
    files = arm.read()
    assert "wrist_roll" in files.component.joints and "turn" not in files.description.joints
    assert files.servo_options[-2:] == ("--xacro-arg", "roll:=wrist_roll")


def test_arguments_need_a_urdf_in_xacro() -> None:
    with pytest.raises(DescriptionError, match=r"--xacro-arg requires a xacro file, but .*arm.urdf does not end in"):
        ControlledArm("so101", xacro_arg=["a:=b"]).read()


@pytest.mark.parametrize("text", ["roll", "roll=1", ":=1"])
def test_an_argument_without_name_or_value_is_refused(text: str) -> None:
    with pytest.raises(DriverError, match="--xacro-arg must be NAME:=VALUE, such as prefix:=left_"):
        xacro_arguments([text])
