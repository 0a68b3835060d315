"""Bring the arm up, and on request the pick-and-place node: what ros2_control's launch files do for other arms.

ros2 launch servoloop robot_arm_ros2_control.launch.py
ros2 launch servoloop robot_arm_ros2_control.launch.py port:=/dev/ttyACM0 pick_place:=true
ros2 launch servoloop robot_arm_ros2_control.launch.py arm:=so101
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction, Shutdown
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.substitutions import ExecutableInPackage

from launch import LaunchContext, LaunchDescription

SHARE = Path(get_package_share_directory("servoloop"))
ARGUMENTS = {
    "arm": ("", "An arm that `servoloop arms` lists, or its folder, with its own urdf, controllers and robot."),
    "urdf": (SHARE / "urdf" / "robot_arm.urdf", "Robot description."),
    "controllers": (SHARE / "config" / "arm_controllers.yaml", "Controllers file, as for ros2_control."),
    "robot": ("", "Robot file; by default the one that the URDF names."),
    "hardware": ("", "servos, mujoco or mock; by default what the URDF's plugin says."),
    "port": ("", "Serial device; NAME=PATH for each of several buses, with spaces between. Without: virtual servos."),
    "pick_place": ("false", "Also start the pick-and-place node."),
}


def command(values: dict[str, str]) -> list[str]:
    """The words after ``servoloop``. What is empty, or belongs to another arm, is left to servoloop's own defaults."""
    ports = [("port", port) for port in values["port"].split()]
    said = {name: values[name] for name in ("arm", "urdf", "controllers", "robot", "hardware")}
    if said["arm"]:
        said = {name: value for name, value in said.items() if value != str(ARGUMENTS[name][0])}
    single = [(name, value) for name, value in said.items() if value]
    return ["up", *(word for name, value in single + ports for word in (f"--{name}", value))]


def start_servoloop(context: LaunchContext) -> list[ExecuteProcess]:
    """Called with the launch arguments' values."""
    values = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    process = ExecuteProcess(
        # not a Node: that would add --ros-args, which is no option of servoloop's
        cmd=[ExecutableInPackage(package="servoloop", executable="servoloop"), *command(values)],
        name="servoloop",
        output="screen",
        # A real arm first drives to its park pose; a second signal would make it let go where it is.
        sigterm_timeout="60",
        sigkill_timeout="15",
        on_exit=Shutdown(reason="servoloop has ended"),
    )
    return [process]


def generate_launch_description() -> LaunchDescription:
    """What ``ros2 launch`` runs."""
    arguments = [
        DeclareLaunchArgument(name, default_value=str(default), description=text)
        for name, (default, text) in ARGUMENTS.items()
    ]
    pick_place = Node(
        package="servoloop",
        executable="vision_pick_place_controller",
        output="screen",
        parameters=[str(SHARE / "config" / "vision_pick_place_controller.yaml")],
        condition=IfCondition(LaunchConfiguration("pick_place")),
    )
    return LaunchDescription([*arguments, OpaqueFunction(function=start_servoloop), pick_place])
