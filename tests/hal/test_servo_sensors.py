"""``<sensor>`` and ``<gpio>`` report values of servos."""

from pathlib import Path

import pytest

from controller.broadcasters.joint_state_broadcaster import BroadcasterParameters, JointStateBroadcaster
from hal.hal_errors import HalError
from servoloop.simulation.stack import SimulatedStack
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.robot_files import Files

VALUES = '<state_interface name="voltage"/><state_interface name="temperature"/>'


def with_elements(folder: Path, elements: str) -> Files:
    """Read an SO-101 with additional elements in its ``<ros2_control>`` block."""
    arm = find_arm("so101")
    urdf = folder / "arm.urdf"
    urdf.write_text(arm.urdf.read_text().replace("</ros2_control>", f"{elements}</ros2_control>"))
    return read_arm_files(arm, urdf, robot=arm.robot)


def test_values_of_a_servo_are_reported_under_the_name_of_the_sensor(tmp_path: Path) -> None:
    source = '<param name="joint">wrist_roll</param>'
    files = with_elements(tmp_path, f'<gpio name="wrist">{source}{VALUES}</gpio>')
    assert files.component.states[-2:] == ("wrist/voltage", "wrist/temperature")
    stack = SimulatedStack(files=files).up()
    stack.run(1.0)
    broadcaster = JointStateBroadcaster.build("b", BroadcasterParameters(), stack.control_stack.context)
    state = stack.loop.hardware.read()
    health = state.health["wrist_roll"]
    reported = dict(zip(broadcaster.interfaces, broadcaster.values(state), strict=True))
    assert reported["wrist"] == [health.voltage_v, health.temperature_c] and health.voltage_v > 6.0
    assert "wrist" not in broadcaster.names


@pytest.mark.parametrize(
    ("elements", "reason"),
    [
        (
            f'<sensor name="a">{VALUES}<command_interface name="led"/></sensor>',
            r"<sensor name='a'> has a <command_interface> \(.*line \d+\): "
            r"use <gpio>, or remove the <command_interface>",
        ),
        (f'<gpio name="gripper">{VALUES}</gpio>', "<gpio name='gripper'> has the same name as another element"),
        (f'<gpio name="a"><param name="joint">knee</param>{VALUES}</gpio>', "refers to joint 'knee', which is not in"),
        (
            '<gpio name="a"><param name="joint">gripper</param><state_interface name="mood"/></gpio>',
            "state interface mood .*, but the servo of gripper reports only voltage, temperature, current, load",
        ),
        (f'<gpio name="a">{VALUES}{VALUES}</gpio>', "<state_interface name='voltage'> twice"),
        (f'<gpio name="a">{VALUES}</gpio>', r"the sensor a \(.*line \d+\) has no source: specify a joint"),
    ],
    ids=["output", "name", "joint", "interface", "twice", "no source"],
)
def test_other_elements_are_refused(elements: str, reason: str, tmp_path: Path) -> None:
    with pytest.raises(HalError, match=reason):
        with_elements(tmp_path, elements)
