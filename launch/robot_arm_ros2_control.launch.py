"""Start the arm, and optionally the pick-and-place node, like the launch files of ros2_control for other arms.

ros2 launch servoloop robot_arm_ros2_control.launch.py
ros2 launch servoloop robot_arm_ros2_control.launch.py port:=/dev/ttyACM0 pick_place:=true
ros2 launch servoloop robot_arm_ros2_control.launch.py arm:=so101 namespace:=left
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
    "arm": ("", "Name of an arm from `servoloop arms`, or an arm folder; it replaces urdf, controllers and robot."),
    "urdf": (SHARE / "urdf" / "robot_arm.urdf", "URDF file."),
    "controllers": (SHARE / "config" / "arm_controllers.yaml", "Controllers file in ros2_control's format."),
    "robot": ("", "Robot file (default: the one named in the URDF)."),
    "hardware": ("", "servos, mujoco or mock (default: the plugin named in the URDF)."),
    "port": ("", "Serial port; NAME=PATH, separated by spaces, for several buses (default: virtual servos)."),
    "namespace": ("", "Namespace of all nodes, so that several arms can share one ROS domain."),
    "pick_place": ("false", "Also start the pick-and-place node."),
}


def command(values: dict[str, str]) -> list[str]:
    """Return the arguments of ``servoloop``. Empty values, and defaults of another arm, are omitted."""
    ports = [("port", port) for port in values["port"].split()]
    said = {name: values[name] for name in ("arm", "urdf", "controllers", "robot", "hardware", "namespace")}
    if said["arm"]:
        said = {name: value for name, value in said.items() if value != str(ARGUMENTS[name][0])}
    single = [(name, value) for name, value in said.items() if value]
    return ["up", *(word for name, value in single + ports for word in (f"--{name}", value))]


def start_servoloop(context: LaunchContext) -> list[ExecuteProcess]:
    """Return the actions for these values of the launch arguments."""
    values = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    process = ExecuteProcess(
        # A Node would add --ros-args, which servoloop does not accept.
        cmd=[ExecutableInPackage(package="servoloop", executable="servoloop"), *command(values)],
        name="servoloop",
        output="screen",
        # A real arm first moves to its park pose. A second signal would release its torque immediately.
        sigterm_timeout="60",
        sigkill_timeout="15",
        on_exit=Shutdown(reason="servoloop has exited"),
    )
    return [process]


def generate_launch_description() -> LaunchDescription:
    """Return the description that ``ros2 launch`` runs."""
    arguments = [
        DeclareLaunchArgument(name, default_value=str(default), description=text)
        for name, (default, text) in ARGUMENTS.items()
    ]
    pick_place = Node(
        package="servoloop",
        executable="vision_pick_place_controller",
        namespace=LaunchConfiguration("namespace"),
        output="screen",
        parameters=[str(SHARE / "config" / "vision_pick_place_controller.yaml")],
        condition=IfCondition(LaunchConfiguration("pick_place")),
    )
    return LaunchDescription([*arguments, OpaqueFunction(function=start_servoloop), pick_place])
