"""Tests of the arguments for MoveIt and RViz. There is no wheel of MoveIt or RViz, but the real ROS parser reads the
parameters."""

import xml.etree.ElementTree as ElementTree
from pathlib import Path
from shutil import copytree
from typing import Any

import pytest
import yaml

pytest.importorskip("rclpy")

from tests.launch.reading import MOVEIT, actions, parse

pytestmark = pytest.mark.ros


def test_moveit_stands_above_the_stack(share: Path) -> None:
    process, move_group, rviz, _ = actions(share / "launch" / MOVEIT, hardware="mujoco")
    assert parse(process.cmd[1:])["hardware"] == "mujoco"
    assert (move_group.package, move_group.executable) == ("moveit_ros_move_group", "move_group")
    assert (rviz.package, rviz.executable) == ("rviz2", "rviz2")
    assert Path(rviz.arguments[rviz.arguments.index("-d") + 1]) == share / "config" / "moveit" / "moveit.rviz"
    assert Path(rviz.arguments[-1]).is_file()


def test_rviz_can_be_left_out(share: Path) -> None:
    _, *others = actions(share / "launch" / MOVEIT, rviz="false", scene="")
    assert [action.package for action in others] == ["moveit_ros_move_group"]


def test_move_group_is_told_what_stands_around_the_arm(share: Path, tmp_path: Path) -> None:
    def told(**arguments: str) -> list[str]:
        call: list[str] = actions(share / "launch" / MOVEIT, **arguments)[-1].cmd
        return call

    service = ["/apply_planning_scene", "moveit_msgs/srv/ApplyPlanningScene"]
    file = share / "config" / "moveit" / "planning_scene.yaml"
    assert told() == ["ros2", "service", "call", *service, file.read_text()]
    own = tmp_path / "bench.yaml"
    own.write_text("scene: {is_diff: true}\n")
    assert told(scene=str(own))[-1] == own.read_text()


def test_another_arm_comes_with_a_folder_of_its_own(share: Path, tmp_path: Path) -> None:
    """The files that `servoloop arms moveit` writes are passed to move_group and RViz."""
    own = share / "config" / "moveit"
    for name in ("joint_limits", "kinematics", "moveit_controllers", "ompl_planning"):
        (tmp_path / f"{name}.yaml").write_text((own / f"{name}.yaml").read_text())
    limits = {"default_robot_padding": 0.01}
    (tmp_path / "joint_limits.yaml").write_text(yaml.safe_dump(limits))
    (tmp_path / "so101.urdf").write_text("<robot name='so101'/>")
    (tmp_path / "so101.srdf").write_text("<robot name='so101'><!-- semantic --></robot>")
    (tmp_path / "planning_scene.yaml").write_text("scene: {is_diff: true}\n")
    process, move_group, rviz, around = actions(share / "launch" / MOVEIT, arm="so101", moveit=str(tmp_path))
    assert parse(process.cmd[1:])["arm"] == "so101"
    model = move_group.parameters[0]
    assert model["robot_description"] == "<robot name='so101'/>"
    assert "semantic" in model["robot_description_semantic"]
    assert model["robot_description_planning"] == limits
    assert rviz.arguments == ["-d", str(tmp_path / "moveit.rviz")] and rviz.parameters == [model]
    assert around.cmd[-1] == "scene: {is_diff: true}\n"


@pytest.mark.parametrize(("given", "namespace"), [("", ""), ("left", "/left"), ("/lab/left", "/lab/left")])
def test_all_programs_are_in_the_namespace(share: Path, given: str, namespace: str) -> None:
    process, move_group, rviz, around = actions(share / "launch" / MOVEIT, namespace=given)
    assert parse(process.cmd[1:])["namespace"] == namespace
    assert [node.namespace.name for node in (move_group, rviz)] == ["namespace"] * 2
    assert around.cmd[3] == f"{namespace}/apply_planning_scene"
    displays = yaml.safe_load(Path(rviz.arguments[-1]).read_text())["Visualization Manager"]["Displays"]
    (motions,) = (display for display in displays if display["Name"] == "MotionPlanning")
    topics = (motions["Planning Scene Topic"], motions["Planned Path"]["Trajectory Topic"])
    assert topics == ("monitored_planning_scene", "display_planned_path")


def test_every_program_comes_from_a_package_that_the_manifest_names(share: Path) -> None:
    manifest = ElementTree.parse(share / "package.xml").getroot()
    known = {"servoloop"} | {element.text for element in manifest.findall("exec_depend")}
    _, *nodes = actions(share / "launch" / MOVEIT, pick_place="true", scene="")
    assert {node.package for node in nodes} <= known
    assert {"ros2service", "moveit_msgs"} <= known  # for `ros2 service call` with a message of MoveIt
    controllers = yaml.safe_load((share / "config" / "moveit" / "moveit_controllers.yaml").read_text())
    planner = yaml.safe_load((share / "config" / "moveit" / "ompl_planning.yaml").read_text())
    assert controllers["moveit_controller_manager"].split("/")[0] in known
    assert planner["planning_plugins"] == ["ompl_interface/OMPLPlanner"]
    assert {"moveit_planners_ompl", "moveit_kinematics"} <= known


def test_move_group_and_stack_get_the_same_robot(share: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.urdf"
    other.write_text((share / "urdf" / "robot_arm.urdf").read_text() + "<!-- another -->\n")
    process, move_group, *_ = actions(share / "launch" / MOVEIT, urdf=str(other))
    assert parse(process.cmd[1:])["urdf"] == other
    assert move_group.parameters[0]["robot_description"] == other.read_text()


def test_moveit_s_parameters_survive_ros_s_own_parser(share: Path, ros_domain: int, tmp_path: Path) -> None:
    """Write each dictionary to a file and pass the file to the node, as launch_ros does."""
    _, move_group, *_ = actions(share / "launch" / MOVEIT)
    wanted: dict[str, Any] = {}
    arguments = ["--ros-args"]
    for number, parameters in enumerate(move_group.parameters):
        file = tmp_path / f"{number}.yaml"
        file.write_text(yaml.dump({"/**": {"ros__parameters": parameters}}, default_flow_style=False))
        arguments += ["--params-file", str(file)]
        wanted |= flat(parameters)
    assert values_in_a_node(arguments) == wanted
    assert wanted["robot_description"] == (share / "urdf" / "robot_arm.urdf").read_text()
    assert wanted["robot_description_planning.joint_limits.joint1.max_acceleration"] == 9.6
    # names under which the planning scene monitor, the OMPL interface and the KDL plugin read these parameters
    assert wanted["robot_description_planning.default_robot_padding"] == 0.02
    assert wanted["ompl.arm.longest_valid_segment_fraction"] == 0.002
    assert wanted["robot_description_kinematics.arm.epsilon"] == 0.001
    assert wanted["moveit_simple_controller_manager.arm_controller.joints"] == [f"joint{i}" for i in range(1, 7)]


def flat(tree: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return the parameters with dotted names, as in ROS."""
    found: dict[str, Any] = {}
    for name, value in tree.items():
        found |= flat(value, f"{prefix}{name}.") if isinstance(value, dict) else {f"{prefix}{name}": value}
    return found


def values_in_a_node(arguments: list[str]) -> dict[str, Any]:
    """Return the parameters of a node named move_group that declares all given parameters, as move_group does."""
    import rclpy
    from rclpy.node import Node as RosNode

    context = rclpy.Context()
    rclpy.init(args=arguments, context=context)
    try:
        node = RosNode("move_group", context=context, automatically_declare_parameters_from_overrides=True)
        parameters = {name: node.get_parameter(name).value for name in node.list_parameters([], 0).names}
        node.destroy_node()
    finally:
        context.shutdown()
    own = ("use_sim_time", "start_type_description_service")
    return {name: value for name, value in parameters.items() if name not in own and not name.startswith("qos_")}


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("kinematics.yaml", "a: &a [*a]", r"kinematics.yaml:1: the file contains itself"),
        ("kinematics.yaml", "a: [", r"kinematics.yaml is not YAML: .*line 2"),
        ("kinematics.yaml", "- a", r"kinematics.yaml:1: the file must contain a mapping"),
        ("joint_limits.yaml", "a: 1\na: 2", r"joint_limits.yaml:2: duplicate key a"),
        ("ompl_planning.yaml", "a: [" + "1, " * 200_000 + "]", r"ompl_planning.yaml has more than 150000 values"),
        ("planning_scene.yaml", "a: " + "[" * 5000, r"planning_scene.yaml:1: the file .* is nested too deeply"),
        ("robot_arm.srdf", "<!-- L\xe4nge -->", r"robot_arm.srdf is not text in UTF-8 \(line 1"),
        ("other.srdf", "<robot/>", r"contains 2 .srdf files instead of one"),
    ],
)
def test_a_file_that_cannot_be_is_refused_in_a_sentence(
    share: Path, tmp_path: Path, name: str, text: str, says: str
) -> None:
    moveit = tmp_path / "moveit"
    copytree(share / "config" / "moveit", moveit)
    (moveit / name).write_text(text, encoding="latin-1")
    with pytest.raises(Exception, match=says) as error:
        actions(share / "launch" / MOVEIT, moveit=str(moveit))
    assert type(error.value).__name__ == "FileError"
