"""Test grippers and broadcasters in a controllers file, and messages for mistakes."""

from pathlib import Path

import pytest

from controller.broadcasters.servo_state_broadcaster import ServoStateBroadcaster
from controller.gripper.gripper_action_controller import GripperActionController
from controller.interface import ControllerContext
from controller.manager.controllers_file import load_controllers_file
from controller.manager.factory import Factory
from controller.manager.manager import ControllerManager
from controller.manager_errors import ControllersFileError
from hal.robot_description.description import parse_urdf
from tests.controller.bench import HAND_LIMITS
from tests.controller.manager_bench import Interfaces

URDF = """
<robot name="hand">
  <link name="palm"/><link name="a"/>
  <joint name="finger" type="prismatic">
    <parent link="palm"/><child link="a"/><axis xyz="0 1 0"/><limit lower="0" upper="0.05" velocity="0.1"/>
  </joint>
  <ros2_control name="hand" type="system">
    <hardware><plugin>mock_components/GenericSystem</plugin></hardware>
    <joint name="finger">
      <command_interface name="position"/><state_interface name="position"/><state_interface name="velocity"/>
    </joint>
  </ros2_control>
</robot>
"""
FILE = """
controller_manager:
  ros__parameters:
    update_rate: 20
    gripper: {type: parallel_gripper_action_controller/GripperActionController}
    servos: {type: servoloop/ServoStateBroadcaster}
gripper:
  ros__parameters:
    joint: finger
    max_effort: 20.0
servos:
  ros__parameters:
    joints: [finger]
"""


def filled(folder: Path, text: str) -> ControllerManager:
    """Return a manager with the controllers of a file."""
    description = parse_urdf(URDF)
    (component,) = description.components
    path = folder / "controllers.yaml"
    path.write_text(text)
    file = load_controllers_file(path, {}, component)
    manager = ControllerManager(Interfaces(tuple(component.commands)), {})
    context = ControllerContext(description, component, {"finger": HAND_LIMITS}, manager.cycle.settled)
    Factory(file, context).fill(manager)
    return manager


def test_the_controllers_are_built_and_parameters_without_effect_are_logged(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    manager = filled(tmp_path, FILE)
    assert isinstance(manager.registry.controllers["gripper"], GripperActionController)
    assert isinstance(manager.registry.controllers["servos"], ServoStateBroadcaster)
    assert "max_effort (torque_limit in the robot file limits the force)" in caplog.text


@pytest.mark.parametrize(
    ("right", "wrong", "words"),
    [
        ("joint: finger", "joint: thumb", r":9: gripper.joint names thumb, which has no command_interface"),
        ("joint: finger", "stall_timeout: 2.0", r"gripper.joint: is missing"),
        (
            "max_effort: 20.0",
            "max_effort_interface: f/e",
            r":10: gripper.max_effort_interface: .*f/e cannot be set by this controller",
        ),
        ("joints: [finger]", "joints: [thumb]", r"controllers.yaml: servos: joints has unknown entries thumb"),
        ("joints: [finger]", "rate: -1.0", r":13: servos.rate: "),
    ],
)
def test_a_mistake_is_reported_with_its_line(tmp_path: Path, right: str, wrong: str, words: str) -> None:
    with pytest.raises(ControllersFileError, match=words):
        filled(tmp_path, FILE.replace(right, wrong))
