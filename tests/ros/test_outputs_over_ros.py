"""The LED of a servo as an output: in the lists of the controller manager, set by a topic, reported in the states."""

import shutil
from pathlib import Path

import pytest
import rclpy
from control_msgs.msg import DynamicJointState
from controller_manager_msgs.srv import ListHardwareInterfaces
from rclpy.executors import SingleThreadedExecutor
from std_msgs.msg import Float64MultiArray

from servoloop.stack.arm_folders import find_arm, read_arm
from tests.ros.stack_process import running, until

pytestmark = pytest.mark.slow

LAMP = (
    '<gpio name="lamp"><param name="joint">gripper</param><command_interface name="led"/>'
    '<state_interface name="led"/><state_interface name="voltage"/></gpio></ros2_control>'
)
CONTROLLER = """
    lamp_controller: {type: forward_command_controller/ForwardCommandController}
lamp_controller: {ros__parameters: {joints: [lamp], interface_name: led}}
"""


def test_led_of_a_servo_is_switched_by_a_topic(ros_domain: int, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(find_arm("koch").folder, tmp_path / "koch"))
    arm = read_arm(folder)
    urdf, controllers = arm.urdf, folder / "controllers.yaml"
    urdf.write_text(urdf.read_text().replace("</ros2_control>", LAMP))
    head, _, rest = controllers.read_text().partition("    joint_state_broadcaster:")
    listed, section = CONTROLLER.strip("\n").split("\n")
    controllers.write_text(f"{head}{listed}\n    joint_state_broadcaster:{rest}\n{section}\n")
    with running(tmp_path, "--arm", str(folder)):
        rclpy.init()
        node, executor = rclpy.create_node("client"), SingleThreadedExecutor()
        executor.add_node(node)
        states: list[DynamicJointState] = []
        node.create_subscription(DynamicJointState, "/dynamic_joint_states", states.append, 10)
        lamp = node.create_publisher(Float64MultiArray, "/lamp_controller/commands", 10)
        client = node.create_client(ListHardwareInterfaces, "/controller_manager/list_hardware_interfaces")
        assert client.wait_for_service(30.0)
        answer = client.call_async(ListHardwareInterfaces.Request())

        def lit() -> bool:
            executor.spin_once(timeout_sec=0.1)
            lamp.publish(Float64MultiArray(data=[1.0]))
            return bool(states) and value(states[-1], "led") == 1.0 and answer.done()

        until(lit)
        assert value(states[-1], "voltage") > 4.0
        (command,) = (one for one in answer.result().command_interfaces if one.name == "lamp/led")
        assert command.is_available and command.is_claimed
        assert "lamp/led" in [one.name for one in answer.result().state_interfaces]
        executor.shutdown()
        node.destroy_node()
        rclpy.shutdown()


def value(message: DynamicJointState, interface: str) -> float:
    """Return the value of an interface of the lamp."""
    found = message.interface_values[list(message.joint_names).index("lamp")]
    return float(dict(zip(found.interface_names, found.values, strict=True))[interface])
