"""Bring the arm up with MoveIt 2 above it: robot_arm_ros2_control.launch.py, move_group and RViz.

ros2 launch servoloop robot_arm_moveit_with_control.launch.py
ros2 launch servoloop robot_arm_moveit_with_control.launch.py port:=/dev/ttyACM0 rviz:=false
ros2 launch servoloop robot_arm_moveit_with_control.launch.py scene:=/home/me/bench.yaml
"""

from pathlib import Path
from typing import Any

import yaml
from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, ExecuteProcess, IncludeLaunchDescription, OpaqueFunction
from launch.conditions import IfCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchContext, LaunchDescription

SHARE = Path(get_package_share_directory("servoloop"))
MOVEIT = SHARE / "config" / "moveit"


def read(name: str) -> dict[str, Any]:
    """One of the YAML files in config/moveit."""
    values: dict[str, Any] = yaml.safe_load((MOVEIT / name).read_text())
    return values


def model_parameters(urdf: Path) -> dict[str, Any]:
    """What both move_group and RViz must know of the arm."""
    return {
        "robot_description": urdf.read_text(),
        "robot_description_semantic": (MOVEIT / "robot_arm.srdf").read_text(),
        "robot_description_kinematics": read("kinematics.yaml"),
        "robot_description_planning": read("joint_limits.yaml"),
        "planning_pipelines": ["ompl"],
        "default_planning_pipeline": "ompl",
        "ompl": read("ompl_planning.yaml"),
    }


def move_group_parameters() -> dict[str, Any]:
    """How trajectories are executed, and what move_group tells others of the scene."""
    return {
        **read("moveit_controllers.yaml"),
        "publish_robot_description_semantic": True,
        "publish_planning_scene": True,
        "publish_geometry_updates": True,
        "publish_state_updates": True,
        "publish_transforms_updates": True,
    }


def tell_surroundings(file: Path) -> ExecuteProcess:
    """One call tells move_group what stands around the arm. It waits until move_group listens.

    Not MoveIt's moveit_publish_scene_from_text: in Jazzy it asks a publisher that it has not made, and with --scene it
    sends paddings of 0 along, which replace that of joint_limits.yaml.
    """
    service = ["/apply_planning_scene", "moveit_msgs/srv/ApplyPlanningScene"]
    call = ["ros2", "service", "call", *service, file.read_text()]
    return ExecuteProcess(cmd=call, name="apply_planning_scene", output="log")  # errors come on the screen all the same


def start_moveit(context: LaunchContext) -> list[Node | ExecuteProcess]:
    """Called with the launch arguments' values."""
    model = model_parameters(Path(LaunchConfiguration("urdf").perform(context)))
    move_group = Node(
        package="moveit_ros_move_group",
        executable="move_group",
        output="screen",
        parameters=[model, move_group_parameters()],
    )
    rviz = Node(
        package="rviz2",
        executable="rviz2",
        output="log",
        arguments=["-d", str(MOVEIT / "moveit.rviz")],
        parameters=[model],
        condition=IfCondition(LaunchConfiguration("rviz")),
    )
    scene = LaunchConfiguration("scene").perform(context)
    return [move_group, rviz, *([tell_surroundings(Path(scene))] if scene else [])]


def generate_launch_description() -> LaunchDescription:
    """What ``ros2 launch`` runs. The other file's arguments are this one's too."""
    control = PythonLaunchDescriptionSource(str(SHARE / "launch" / "robot_arm_ros2_control.launch.py"))
    return LaunchDescription(
        [
            DeclareLaunchArgument("rviz", default_value="true", description="Also start RViz."),
            DeclareLaunchArgument(
                "scene",
                default_value=str(MOVEIT / "planning_scene.yaml"),
                description="What stands around the arm, for MoveIt; with scene:= nothing does.",
            ),
            # the included file's too, but needed here as well
            DeclareLaunchArgument("urdf", default_value=str(SHARE / "urdf" / "robot_arm.urdf")),
            IncludeLaunchDescription(control),
            OpaqueFunction(function=start_moveit),
        ]
    )
