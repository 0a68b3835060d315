"""Start the arm, and optionally the pick-and-place node, like the launch files of ros2_control for other arms.

ros2 launch servoloop robot_arm_ros2_control.launch.py
ros2 launch servoloop robot_arm_ros2_control.launch.py port:=/dev/ttyACM0 pick_place:=true
ros2 launch servoloop robot_arm_ros2_control.launch.py arm:=so101 namespace:=left
"""

from pathlib import Path
from typing import Any

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction, Shutdown
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.substitutions import ExecutableInPackage

from drivers.paths import resolved
from hal.hal_errors import ArmFileError
from hal.yaml_nodes import read
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
    "pick_place": ("false", "Also start the pick-and-place node, with the poses of the arm."),
}


def command(values: dict[str, str]) -> list[str]:
    """Return the arguments of ``servoloop``. Empty values, and defaults of another arm, are omitted."""
    ports = [("port", port) for port in values["port"].split()]
    said = {name: values[name] for name in ("arm", "urdf", "controllers", "robot", "hardware", "namespace")}
    if said["arm"]:
        said = {name: value for name, value in said.items() if value != str(ARGUMENTS[name][0])}
    single = [(name, value) for name, value in said.items() if value]
    return ["up", *(word for name, value in single + ports for word in (f"--{name}", value))]


def poses(values: dict[str, str]) -> Path:
    """Return the parameter file of the pick-and-place node. Raises ArmFileError if the poses of the arm are unknown."""
    name = values["arm"]
    if not name and values["urdf"] != str(ARGUMENTS["urdf"][0]):
        raise ArmFileError(
            f"pick_place:=true would move the arm of {values['urdf']} to the poses of robot_arm: specify the arm "
            "folder with its poses as arm:=FOLDER, or arm:=robot_arm if these poses are safe"
        )
    shipped = SHARE / "config" / "arms" / (name or "robot_arm")
    path = pick_place_file(shipped if "/" not in name and shipped.is_dir() else Path(name))
    if not path.is_file():
        raise ArmFileError(f"pick_place:=true requires {path}: add this file with the poses of the arm")
    return path


def pick_place_file(folder: Path) -> Path:
    """Return the path that ``arm.yaml`` specifies, as ``ArmFolder.pick_place`` does.

    This function needs only PyYAML, because the Python of ``ros2 launch`` may not have servoloop's other dependencies.
    """
    own = arm_file(folder)
    if "pick_place" not in own and "like" in own:
        folder = folder / str(own["like"])
        own = arm_file(folder)
    return resolved(folder / str(own.get("pick_place", "pick_place.yaml")))


def arm_file(folder: Path) -> dict[str, Any]:
    """Read ``arm.yaml`` without checking its values. Raises ArmFileError."""
    _, values = read(folder / "arm.yaml", ArmFileError)
    return values if isinstance(values, dict) else {}


def given(context: LaunchContext) -> dict[str, str]:
    """Return the values of the launch arguments."""
    return {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}


def start_servoloop(context: LaunchContext) -> list[ExecuteProcess]:
    """Return the actions for these values of the launch arguments."""
    process = ExecuteProcess(
        # A Node would add --ros-args, which servoloop does not accept.
        cmd=[ExecutableInPackage(package="servoloop", executable="servoloop"), *command(given(context))],
        name="servoloop",
        output="screen",
        # A real arm first moves to its park pose. A second signal would release its torque immediately.
        sigterm_timeout="60",
        sigkill_timeout="15",
        on_exit=Shutdown(reason="servoloop has exited"),
    )
    return [process]


def start_pick_place(context: LaunchContext) -> list[Node]:
    """Return the pick-and-place node if the launch arguments request it."""
    if not IfCondition(LaunchConfiguration("pick_place")).evaluate(context):
        return []
    node = Node(
        package="servoloop",
        executable="vision_pick_place_controller",
        namespace=LaunchConfiguration("namespace"),
        output="screen",
        parameters=[str(poses(given(context)))],
    )
    return [node]


def generate_launch_description() -> LaunchDescription:
    """Return the description that ``ros2 launch`` runs."""
    arguments = [
        DeclareLaunchArgument(name, default_value=str(default), description=text)
        for name, (default, text) in ARGUMENTS.items()
    ]
    started = [OpaqueFunction(function=start) for start in (start_servoloop, start_pick_place)]
    return LaunchDescription([*arguments, *started])
