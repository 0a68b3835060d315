"""The files in docs/ros2-control-host.md match the SO-101 in the arm folder."""

import re
from pathlib import Path

import pytest

from controller.manager.controllers_file import load_controllers_file
from hal.robot_description.description import parse_urdf
from servoloop.stack.arm_folders import find_arm, read_arm_files
from tests.pages import code

PAGE = "ros2-control-host.md"
BLOCK = re.compile(r"<ros2_control .*</ros2_control>", re.DOTALL)


@pytest.mark.runs(f"{PAGE} xml 1", f"{PAGE} yaml 1")
def test_block_and_controllers_file_fit_the_arm(tmp_path: Path) -> None:
    arm = read_arm_files(find_arm("so101"), None, None, None)
    (component,) = parse_urdf(BLOCK.sub(code(PAGE, "xml"), arm.urdf_path.read_text()), "so101.urdf").components
    assert component.plugin == "joint_state_topic_hardware_interface/JointStateTopicSystem"
    assert component.joints == arm.component.joints
    assert component.command_interfaces == arm.component.command_interfaces
    assert component.state_interfaces == arm.component.state_interfaces
    controllers = tmp_path / "controllers.yaml"
    controllers.write_text(code(PAGE, "yaml"))
    file = load_controllers_file(controllers, {}, component)
    assert [spec.name for spec in file.controllers] == ["joint_state_broadcaster", "arm_controller"]
    assert file.update_rate_hz == 100
