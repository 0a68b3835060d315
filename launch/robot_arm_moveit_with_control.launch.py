"""Start the arm with MoveIt 2: robot_arm_ros2_control.launch.py, move_group and RViz.

ros2 launch servoloop robot_arm_moveit_with_control.launch.py
ros2 launch servoloop robot_arm_moveit_with_control.launch.py port:=/dev/ttyACM0 rviz:=false
ros2 launch servoloop robot_arm_moveit_with_control.launch.py scene:=/home/me/bench.yaml
ros2 launch servoloop robot_arm_moveit_with_control.launch.py arm:=so101 moveit:=/home/me/so101_moveit
"""

from pathlib import Path
from typing import Any

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, ExecuteProcess, IncludeLaunchDescription, OpaqueFunction
from launch.conditions import IfCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from hal.text_file import read_text, read_xml
from hal.yaml_nodes import read as read_yaml
from launch import LaunchContext, LaunchDescription
from nodes.namespace import parse_namespace

SHARE = Path(get_package_share_directory("servoloop"))
MOVEIT = SHARE / "config" / "moveit"
URDF = SHARE / "urdf" / "robot_arm.urdf"
SCENE = "planning_scene.yaml"


class FileError(Exception):
    """Raised if a file cannot be used. `ros2 launch` prints the message, which contains the reason."""


def read(file: Path) -> dict[str, Any]:
    """Read a YAML file that contains a mapping. Raises FileError if it does not."""
    _, values = read_yaml(file, FileError)
    if not isinstance(values, dict):
        raise FileError(f"{file}:1: the file must contain a mapping from parameter names to values")
    return values


def described(urdf: Path, moveit: Path) -> Path:
    """Return the path of the given URDF, or by default of the URDF in the folder that `servoloop arms moveit` wrote."""
    written = sorted(moveit.glob("*.urdf")) if urdf == URDF else []
    return written[0] if written else urdf


def model_parameters(urdf: Path, moveit: Path) -> dict[str, Any]:
    """Return the parameters of the arm for move_group and RViz."""
    semantic = sorted(moveit.glob("*.srdf"))
    if len(semantic) != 1:
        raise FileError(
            f"{moveit} contains {len(semantic)} .srdf files instead of one: use a folder that `servoloop arms "
            "moveit` wrote"
        )
    return {
        "robot_description": read_xml(described(urdf, moveit), FileError, "the URDF"),
        "robot_description_semantic": read_xml(semantic[0], FileError, "the SRDF"),
        "robot_description_kinematics": read(moveit / "kinematics.yaml"),
        "robot_description_planning": read(moveit / "joint_limits.yaml"),
        "planning_pipelines": ["ompl"],
        "default_planning_pipeline": "ompl",
        "ompl": read(moveit / "ompl_planning.yaml"),
    }


def move_group_parameters(moveit: Path) -> dict[str, Any]:
    """Return the parameters for executing trajectories and publishing the scene."""
    return {
        **read(moveit / "moveit_controllers.yaml"),
        "publish_robot_description_semantic": True,
        "publish_planning_scene": True,
        "publish_geometry_updates": True,
        "publish_state_updates": True,
        "publish_transforms_updates": True,
    }


def tell_surroundings(file: Path, namespace: str) -> ExecuteProcess:
    """Send the objects around the arm to move_group in one call, which waits until move_group is ready.

    MoveIt's moveit_publish_scene_from_text is not used: in Jazzy it uses a publisher that it has not created. With
    --scene it also sends paddings of 0, which replace the padding in joint_limits.yaml.
    """
    read(file)
    service = [f"{namespace}/apply_planning_scene", "moveit_msgs/srv/ApplyPlanningScene"]
    call = ["ros2", "service", "call", *service, read_text(file, FileError)]
    return ExecuteProcess(cmd=call, name="apply_planning_scene", output="log")  # errors are still printed


def start_moveit(context: LaunchContext) -> list[Node | ExecuteProcess]:
    """Return the actions for these values of the launch arguments."""
    moveit = Path(LaunchConfiguration("moveit").perform(context))
    model = model_parameters(Path(LaunchConfiguration("urdf").perform(context)), moveit)
    move_group = Node(
        package="moveit_ros_move_group",
        executable="move_group",
        namespace=LaunchConfiguration("namespace"),
        output="screen",
        parameters=[model, move_group_parameters(moveit)],
    )
    rviz = Node(
        package="rviz2",
        executable="rviz2",
        namespace=LaunchConfiguration("namespace"),
        output="log",
        arguments=["-d", str(moveit / "moveit.rviz")],
        parameters=[model],
        condition=IfCondition(LaunchConfiguration("rviz")),
    )
    scene = LaunchConfiguration("scene").perform(context)
    around = moveit / SCENE if scene == str(MOVEIT / SCENE) else Path(scene)
    namespace = parse_namespace(LaunchConfiguration("namespace").perform(context))
    return [move_group, rviz, *([tell_surroundings(around, namespace)] if scene else [])]


def generate_launch_description() -> LaunchDescription:
    """Return the description that ``ros2 launch`` runs, including the arguments of the included file."""
    control = PythonLaunchDescriptionSource(str(SHARE / "launch" / "robot_arm_ros2_control.launch.py"))
    return LaunchDescription(
        [
            DeclareLaunchArgument("rviz", default_value="true", description="Also start RViz."),
            DeclareLaunchArgument(
                "moveit",
                default_value=str(MOVEIT),
                description="Folder with the MoveIt files that `servoloop arms moveit` wrote.",
            ),
            DeclareLaunchArgument(
                "scene",
                default_value=str(MOVEIT / SCENE),
                description="Scene file to use instead of the one in the folder. An empty scene:= means no objects "
                "around the arm.",
            ),
            # The included file also declares these arguments, but start_moveit needs them too.
            DeclareLaunchArgument("urdf", default_value=str(URDF)),
            DeclareLaunchArgument("namespace", default_value=""),
            IncludeLaunchDescription(control),
            OpaqueFunction(function=start_moveit),
        ]
    )
