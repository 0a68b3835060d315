"""Test controllers files in ros2_control's format: their controllers and the messages for mistakes."""

from pathlib import Path
from typing import Any, cast

import pytest
from pydantic import ValidationError

from controller.broadcasters.joint_state_broadcaster import JointStateBroadcaster
from controller.forward.forward_command_controller import ForwardCommandController
from controller.interface import ControllerContext
from controller.manager.controller_spec import ControllerSpec
from controller.manager.controllers_file import ControllersFile, load_controller, load_controllers_file
from controller.manager.factory import Factory
from controller.manager.manager import ControllerManager
from controller.manager.settings import ManagerSettings
from controller.manager_errors import ControllersFileError
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from hal.file_size import LARGEST_BYTES
from hal.robot_description.description import Description, HardwareInfo, parse_urdf
from hal.yaml_nodes import YamlFile
from tests.controller.manager_bench import Interfaces

URDF = """
<robot name="r">
  <link name="world"/><link name="a"/><link name="b"/><link name="c"/><link name="d"/>
  <joint name="joint1" type="revolute">
    <parent link="world"/><child link="a"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="2"/>
  </joint>
  <joint name="joint2" type="revolute">
    <parent link="a"/><child link="b"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="2"/>
  </joint>
  <joint name="right" type="prismatic">
    <parent link="b"/><child link="c"/><axis xyz="0 1 0"/><limit lower="0" upper="0.05" velocity="0.1"/>
  </joint>
  <joint name="left" type="prismatic">
    <parent link="b"/><child link="d"/><axis xyz="0 1 0"/><limit lower="0" upper="0.05" velocity="0.1"/>
    <mimic joint="right"/>
  </joint>
  <ros2_control name="arm" type="system">
    <hardware><plugin>mock_components/GenericSystem</plugin></hardware>
    <joint name="joint1">
      <command_interface name="position"/><state_interface name="position"/><state_interface name="velocity"/>
    </joint>
    <joint name="joint2"><command_interface name="position"/><state_interface name="position"/></joint>
    <joint name="right"><command_interface name="position"/><state_interface name="position"/></joint>
    <joint name="left"><state_interface name="position"/></joint>
  </ros2_control>
</robot>
"""

PLAIN = """
controller_manager:
  ros__parameters:
    update_rate: 20
    joint_state_broadcaster:
      type: joint_state_broadcaster/JointStateBroadcaster
    arm_controller:
      type: joint_trajectory_controller/JointTrajectoryController
    hand_controller:
      type: forward_command_controller/ForwardCommandController
arm_controller:
  ros__parameters:
    joints: [joint1, joint2]
    command_interfaces: [position]
    state_interfaces: [position, velocity]
    allow_nonzero_velocity_at_trajectory_end: true
hand_controller:
  ros__parameters:
    joints: [right]
    interface_name: position
"""

DEFAULTS = {"arm_controller": {"wait_for": ["hand_controller"], "wait_for_timeout": 0.7, "command_lead": 0.01}}
ARM_TYPE = "joint_trajectory_controller/JointTrajectoryController"
HAND_TYPE = "forward_command_controller/ForwardCommandController"


def description() -> tuple[Description, HardwareInfo]:
    parsed = parse_urdf(URDF)
    return parsed, parsed.components[0]


def load(tmp_path: Path, text: str, defaults: dict[str, Any] | None = None) -> ControllersFile:
    path = tmp_path / "controllers.yaml"
    path.write_text(text)
    return load_controllers_file(path, defaults or {}, description()[1])


def arm_of(file: ControllersFile) -> JointTrajectoryController:
    from hal.types import JointLimits

    parsed, component = description()
    limits = {name: JointLimits(-1.0, 1.0, 2.0, 10.0, 100.0) for name in component.joints}
    settled = ControllerManager(Interfaces(tuple(component.commands)), {}).cycle.settled
    factory = Factory(file, ControllerContext(parsed, component, limits, settled))
    controllers = [factory.make(spec) for spec in file.controllers]
    assert [type(c) for c in controllers] == [
        JointStateBroadcaster,
        JointTrajectoryController,
        ForwardCommandController,
    ]
    return next(c for c in controllers if isinstance(c, JointTrajectoryController))


def test_a_plain_ros2_control_file_works_with_the_robot_files_defaults(tmp_path: Path) -> None:
    file = load(tmp_path, PLAIN, DEFAULTS)
    assert file.update_rate_hz == 20
    assert [c.name for c in file.controllers] == ["joint_state_broadcaster", "arm_controller", "hand_controller"]
    arm = arm_of(file)
    assert arm.joints == ("joint1", "joint2")
    assert arm.parameters.allow_nonzero_velocity_at_trajectory_end
    assert arm.parameters.wait_for == ("hand_controller",)
    assert (arm.parameters.wait_for_timeout, arm.parameters.command_lead) == (0.7, 0.01)


def test_without_defaults_the_parameters_are_those_of_ros2_control(tmp_path: Path) -> None:
    parameters = arm_of(load(tmp_path, PLAIN)).parameters
    assert (parameters.wait_for, parameters.command_lead) == ((), None)
    assert not any((*parameters.tolerances().path.values(), *parameters.tolerances().goal.values()))
    assert parameters.tolerances().goal_time_s == 0.0


def test_the_controllers_file_overrides_the_defaults(tmp_path: Path) -> None:
    own = PLAIN.replace("    joints: [joint1", "    wait_for: []\n    joints: [joint1")
    assert arm_of(load(tmp_path, own, DEFAULTS)).parameters.wait_for == ()


def test_defaults_may_name_a_controller_that_is_not_in_the_file(tmp_path: Path) -> None:
    text = PLAIN.replace("hand_controller", "gripper")
    assert arm_of(load(tmp_path, text, DEFAULTS)).parameters.wait_for == ("hand_controller",)


def test_tolerances(tmp_path: Path) -> None:
    constraints = """
    constraints:
      goal_time: 0.6
      stopped_velocity_tolerance: 0.02
      joint1: {trajectory: 0.05, goal: 0.03}
      joint2: {goal: 0.04}
"""
    text = PLAIN.replace("    state_interfaces", constraints.lstrip("\n") + "    state_interfaces", 1)
    tolerances = arm_of(load(tmp_path, text)).parameters.tolerances()
    assert tolerances.path == {"joint1": 0.05, "joint2": 0.0}
    assert tolerances.goal == {"joint1": 0.03, "joint2": 0.04}
    assert tolerances.goal_time_s == 0.6


def test_the_default_update_rate_is_that_of_ros2_control(tmp_path: Path) -> None:
    assert load(tmp_path, PLAIN.replace("    update_rate: 20\n", "")).update_rate_hz == 100


def test_unused_ros2_control_parameters_are_logged(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    load(tmp_path, PLAIN.replace("    state_interfaces", "    open_loop_control: true\n    state_interfaces", 1))
    assert "controllers.yaml:15: arm_controller: parameter without effect: open_loop_control" in caplog.text


@pytest.mark.parametrize(
    ("lines", "unknown"),
    [
        ("constraints: {joint1: {gaol: 0.05, goal: 0.1}}", "constraints.joint1.gaol"),
        ("constraints: {joint2: {trajectry: 0.3}}", "constraints.joint2.trajectry"),
        ("speed_scaling: {initial_scaling: 0.5}", "speed_scaling.initial_scaling"),
    ],
)
def test_an_unknown_key_in_a_parameter_group_is_logged_with_its_line(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, lines: str, unknown: str
) -> None:
    load(tmp_path, PLAIN.replace("    state_interfaces", f"    {lines}\n    state_interfaces", 1))
    assert f"controllers.yaml:15: arm_controller: parameter without effect: {unknown}\n" in caplog.text


def test_the_last_value_of_a_duplicate_key_is_used_and_logged_with_both_lines(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    lines = "command_lead: 0.1\n    command_lead: 0.2\n"
    file = load(tmp_path, PLAIN.replace("    state_interfaces", f"    {lines}    state_interfaces", 1))
    assert arm_of(file).parameters.command_lead == 0.2
    text = (
        "controllers.yaml:16: arm_controller.command_lead replaces the value in line 15, as in rcl: remove one of them"
    )
    assert [line for line in caplog.messages if line.endswith(text)]


def test_an_unknown_setting_of_a_controller_is_logged_with_its_line(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    load(tmp_path, with_entry("fallback_controlers: [arm_controller]"))
    said = "controllers.yaml:11: controller_manager: parameter without effect: hand_controller.fallback_controlers\n"
    assert said in caplog.text


MISTAKES = {
    "an unknown joint": (
        ("[joint1, joint2]", "[joint1, joint7]"),
        ["arm_controller.joints names joint7, which has no command_interface in the URDF's <ros2_control> block"],
    ),
    "a joint without command interface": (
        ("[right]", "[left]"),
        ["hand_controller.joints names left, which has no command_interface"],
    ),
    "a joint twice": (("[joint1, joint2]", "[joint1, joint1]"), ["arm_controller.joints names joint1 twice"]),
    "an unknown type": (
        (ARM_TYPE, "diff_drive_controller/DiffDriveController"),
        ["arm_controller has unknown type 'diff_drive_controller/DiffDriveController'; known types are " + ARM_TYPE],
    ),
    "an invalid node name": (
        ("    hand_controller:\n", "    hand-2:\n"),
        ["hand-2 is not a valid controller name: use letters, digits and _, and do not start with a digit"],
    ),
    "a long name": (
        ("    hand_controller:\n", f"    {'hand_' * 21}:\n"),
        [f"{'hand_' * 21} has 105 characters: shorten the name to at most 100"],
    ),
    "the name of the manager": (
        ("    hand_controller:\n", "    controller_manager:\n"),
        ["controller_manager is the name of a node of the stack itself: rename the controller"],
    ),
    "the name of a component": (
        ("    hand_controller:\n", "    arm:\n"),
        ["arm is also the name of a <ros2_control> block, whose node has the same name: rename one of them"],
    ),
    "no joints": (("[joint1, joint2]", "[]"), ["arm_controller.joints: "]),
    "missing joints": (("    joints: [right]\n", ""), ["hand_controller.joints: is missing: add the key"]),
    "joints of the wrong kind": (("[right]", "7"), ["hand_controller.joints: "]),
    "an unknown interface": (
        ("interface_name: position", "interface_name: effort"),
        [
            "hand_controller.joints needs right/effort, "
            "which is not a command_interface in the URDF's <ros2_control> block"
        ],
    ),
    "a rate of zero": (("update_rate: 20", "update_rate: 0"), ["controller_manager.update_rate: "]),
    "an implausible rate": (("update_rate: 20", "update_rate: 100000"), ["controller_manager.update_rate: "]),
    "a rate as text": (("update_rate: 20", "update_rate: fast"), ["controller_manager.update_rate: "]),
    "a negative lead": (
        ("    joints: [joint1", "    command_lead: -0.1\n    joints: [joint1"),
        ["arm_controller.command_lead: "],
    ),
    "an infinite wait": (
        ("    joints: [joint1", "    wait_for_timeout: .inf\n    joints: [joint1"),
        ["arm_controller.wait_for_timeout: "],
    ),
    "a wait for an unknown controller": (
        ("    joints: [joint1", "    wait_for: [hand_controler]\n    joints: [joint1"),
        ["wait_for names hand_controler, which is not another controller in this file: correct the name"],
    ),
    "a wait for itself": (
        ("    joints: [joint1", "    wait_for: [arm_controller]\n    joints: [joint1"),
        ["wait_for names arm_controller, which is not another controller in this file: correct the name"],
    ),
    "a negative tolerance": (
        ("    joints: [joint1", "    constraints: {joint1: {goal: -0.1}}\n    joints: [joint1"),
        ["arm_controller.constraints.joint1.goal: "],
    ),
    "a tolerance as text": (
        ("    joints: [joint1", "    constraints: {joint1: wide}\n    joints: [joint1"),
        ["arm_controller.constraints.joint1: "],
    ),
    "an unknown method": (
        ("    joints: [joint1", "    interpolation_method: cubic\n    joints: [joint1"),
        ["arm_controller.interpolation_method: must be 'splines', 'none' or 'ruckig'"],
    ),
}


@pytest.mark.parametrize(("change", "texts"), MISTAKES.values(), ids=MISTAKES.keys())
def test_each_mistake_is_reported_with_file_and_line(tmp_path: Path, change: tuple[str, str], texts: list[str]) -> None:
    assert change[0] in PLAIN
    with pytest.raises(ControllersFileError) as error:
        load(tmp_path, PLAIN.replace(*change, 1))
    lines = str(error.value).splitlines()
    assert len(lines) == len(texts)
    for line, text in zip(lines, texts, strict=True):
        assert line.startswith(f"{tmp_path / 'controllers.yaml'}")
        assert text in line


def test_all_mistakes_are_reported_at_once(tmp_path: Path) -> None:
    text = (
        PLAIN.replace("update_rate: 20", "update_rate: -1")
        .replace("[joint1, joint2]", "[joint1, joint9]")
        .replace("interface_name: position", "interface_name: velocity")
    )
    with pytest.raises(ControllersFileError) as error:
        load(tmp_path, text)
    assert len(str(error.value).splitlines()) == 3


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("arm_controller: {}", "has no controller_manager"),
        ("a: [1, 2", "is not YAML"),
        ("- a\n- b", "controllers.yaml:1: "),
        ("", "controllers.yaml:1: "),
        ("controller_manager:\n  ros__parameters: 7", "controllers.yaml:2: controller_manager.ros__parameters is not"),
    ],
    ids=["no manager", "bad YAML", "a list", "empty", "parameters are a number"],
)
def test_a_file_of_the_wrong_structure_is_rejected(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ControllersFileError, match=message):
        load(tmp_path, text)


def test_a_missing_file_is_rejected(tmp_path: Path) -> None:
    missing = tmp_path / "missing.yaml"
    with pytest.raises(ControllersFileError, match=r"cannot read .*missing\.yaml: No such file"):
        load_controllers_file(missing, {}, description()[1])


def test_several_controllers_may_use_the_same_joint(tmp_path: Path) -> None:
    file = load(tmp_path, PLAIN.replace("[right]", "[right, joint2]"))
    assert len(file.controllers) == 3


def test_a_file_without_controllers_is_accepted_with_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    file = load(tmp_path, "controller_manager: {ros__parameters: {update_rate: 20, overruns: {manage: true}}}")
    assert file.controllers == ()
    assert "controller_manager lists no controllers: load them with a spawner" in caplog.text


SAID_OF_ALL = """
/**:
  ros__parameters: {interface_name: position, joints: [joint1]}
  hand_controller:
    ros__parameters: {joints: [joint2]}
/**/hand_controller:
  ros__parameters: {command_timeout: 0.5}
/controller_manager:
  ros__parameters:
    hand_controller: {type: forward_command_controller/ForwardCommandController, fallback_controllers: [spare]}
    other: {type: forward_command_controller/ForwardCommandController, fallback_controllers: spare}
    spare: {type: forward_command_controller/ForwardCommandController}
"""


def test_node_patterns_and_slashes_work_as_in_ros(tmp_path: Path) -> None:
    hand, other, _ = load(tmp_path, SAID_OF_ALL).controllers
    assert (hand.parameters.claims(), other.parameters.claims()) == (("joint2/position",), ("joint1/position",))
    assert (hand.fallback, other.fallback) == (("spare",), ("spare",))


# Controllers loaded by a spawner


def spec(tmp_path: Path, name: str, kind: str, *texts: str) -> ControllerSpec:
    paths = []
    for number, text in enumerate(texts):
        paths.append(tmp_path / f"more{number}.yaml")
        paths[-1].write_text(text)
    file = load(tmp_path, PLAIN, DEFAULTS)
    return load_controller(file, name, ManagerSettings(kind, tuple(paths)), description()[1])


def test_a_spawner_can_load_a_controller_that_is_not_in_the_file(tmp_path: Path) -> None:
    text = "wrist: {ros__parameters: {type: ignored/Here, joints: [joint2], interface_name: position}}"
    made = spec(tmp_path, "wrist", HAND_TYPE, text)
    assert (made.name, made.kind, made.parameters.claims()) == ("wrist", HAND_TYPE, ("joint2/position",))
    assert made.parameters.unused() == []


def test_required_parameters_may_be_set_after_loading(tmp_path: Path) -> None:
    made = spec(tmp_path, "wrist", HAND_TYPE, "wrist: {ros__parameters: {joints: [joint2], command_timeout: 2.0}}")
    assert made.parameters.missing() == ("interface_name",)
    with pytest.raises(ValueError, match="wrist requires interface_name: set it on its node /wrist"):
        Factory(load(tmp_path, PLAIN, DEFAULTS), cast(Any, None)).make(made)
    later = made.parameters.as_far_as_given(
        {**made.parameters.model_dump(warnings=False), "interface_name": "position"}
    )
    assert (later.missing(), later.claims()) == ((), ("joint2/position",))
    with pytest.raises(ValidationError, match="command_timeout"):
        made.parameters.as_far_as_given({"joints": ["joint2"], "command_timeout": -1.0})


def test_a_spawner_keeps_the_fallback_of_the_controllers_file(tmp_path: Path) -> None:
    path = tmp_path / "controllers.yaml"
    path.write_text(PLAIN.replace(f"{ARM_TYPE}\n", f"{ARM_TYPE}\n      fallback_controllers: [hand_controller]\n"))
    more = tmp_path / "more.yaml"
    more.write_text("arm_controller: {ros__parameters: {joints: [joint1]}}")
    file = load_controllers_file(path, {}, description()[1])
    made = load_controller(file, "arm_controller", ManagerSettings(ARM_TYPE, (more,)), description()[1])
    assert (made.fallback, made.parameters.claims()) == (("hand_controller",), ("joint1/position",))


def test_later_parameter_files_override_earlier_ones_and_the_controllers_file(tmp_path: Path) -> None:
    first = "arm_controller: {ros__parameters: {joints: [joint2], command_lead: 0.1}}"
    made = spec(tmp_path, "arm_controller", ARM_TYPE, first, "/**: {ros__parameters: {command_lead: 0.2}}")
    assert made.parameters.model_dump(include={"joints", "command_lead", "wait_for"}) == {
        "joints": ("joint2",),
        "command_lead": 0.2,
        "wait_for": ("hand_controller",),
    }
    assert spec(tmp_path, "arm_controller", ARM_TYPE).parameters.claims() == ("joint1/position", "joint2/position")


@pytest.mark.parametrize(
    ("name", "kind", "text", "said"),
    [
        (
            "wrist",
            "no/Such",
            "wrist: {ros__parameters: {}}",
            "controller_manager.wrist has unknown type 'no/Such'; known",
        ),
        (
            "wrist",
            HAND_TYPE,
            "hand: {ros__parameters: {}}",
            "more0.yaml has no section for wrist: add 'wrist: ",
        ),
        (
            "wrist",
            HAND_TYPE,
            "wrist: {ros__parameters: {joints: [joint1], interface_name: smell}}",
            "more0.yaml:1: wrist.joints needs joint1/smell, which is not a command_interface",
        ),
        ("wrist", HAND_TYPE, "wrist: [", "more0.yaml is not YAML"),
        (
            "wrist",
            HAND_TYPE,
            "wrist:\n  ros__parameters:\n    interface_name: position\n    joints: [joint9]",
            "more0.yaml:4: wrist.joints names joint9, which has no command_interface",
        ),
    ],
)
def test_mistakes_in_a_spawners_files_are_reported_with_the_file(
    tmp_path: Path, name: str, kind: str, text: str, said: str
) -> None:
    with pytest.raises(ControllersFileError) as error:
        spec(tmp_path, name, kind, text)
    assert said in str(error.value)


def test_the_controllers_files_in_this_repository_are_valid() -> None:
    from servoloop.stack.robot_files import read_files

    files = read_files()
    assert files.controllers.update_rate_hz == 20
    assert [c.name for c in files.controllers.controllers] == [
        "joint_state_broadcaster",
        "arm_controller",
        "hand_controller",
    ]


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("'': 1", ":15: arm_controller has a parameter without a name: give the parameter a name"),
        ("own: {'': 1}", ":15: arm_controller.own has a parameter without a name"),
        ("own..part: 1", "arm_controller.own has a parameter without a name"),
        ("own: [1, 2.0]", ":15: arm_controller.own mixes float and int in one list: use one type for all elements"),
        ("own: [[1, 2]]", ":15: arm_controller.own has a list or a mapping within a list: ROS"),
        ("own: [{a: 1}]", ":15: arm_controller.own has a list or a mapping within a list: ROS"),
        ("own:", ":15: arm_controller.own has no value"),
    ],
)
def test_values_that_ros_parameters_do_not_support_are_rejected(tmp_path: Path, line: str, says: str) -> None:
    text = PLAIN.replace("    state_interfaces:", f"    {line}\n    state_interfaces:")
    with pytest.raises(ControllersFileError) as error:
        load(tmp_path, text)
    assert says in str(error.value)


def test_the_defaults_of_a_robot_file_are_checked_too(tmp_path: Path) -> None:
    with pytest.raises(ControllersFileError, match="arm_controller has a parameter without a name: give the"):
        load(tmp_path, PLAIN, {"arm_controller": {"": 1}})
    with pytest.raises(ControllersFileError, match=r"arm_controller\.own\.part has a parameter without a name"):
        load(tmp_path, PLAIN, {"arm_controller": {"own": {"part..x": 1}}})


def test_a_misspelled_section_is_reported_with_the_controllers_file(tmp_path: Path) -> None:
    origin, path = YamlFile(tmp_path / "robot.yaml", None), tmp_path / "controllers.yaml"
    path.write_text(PLAIN.replace("arm_controller:\n  ros", "arm_ctrl:\n  ros"))
    with pytest.raises(ControllersFileError) as error:
        load_controllers_file(path, DEFAULTS, description()[1], origin)
    assert str(error.value).splitlines() == [
        f"{path}:7: arm_controller.joints: is missing: add the key",
        f"{path}:11: the section arm_ctrl is not used: rename the section to arm_controller",
    ]


def test_a_wrong_default_is_reported_with_the_robot_file(tmp_path: Path) -> None:
    origin, path = YamlFile(tmp_path / "robot.yaml", None), tmp_path / "controllers.yaml"
    path.write_text(PLAIN)
    with pytest.raises(ControllersFileError, match=r"^\S+robot.yaml:1: arm_controller.command_lead: must be"):
        load_controllers_file(path, {"arm_controller": {"command_lead": -1.0}}, description()[1], origin)


def test_numeric_joint_names_must_be_quoted(tmp_path: Path) -> None:
    with pytest.raises(ControllersFileError) as error:
        load(tmp_path, PLAIN.replace("[joint1, joint2]", "[1, 2]"))
    assert ":13: arm_controller.joints.0: 1 is read as a number: put the text in quotes ('1')" in str(error.value)


def test_a_list_of_command_interfaces_with_position_uses_position(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    file = load(tmp_path, PLAIN.replace("command_interfaces: [position]", "command_interfaces: [position, velocity]"))
    assert file.controllers[1].parameters.claims() == ("joint1/position", "joint2/position")
    assert caplog.text.count("arm_controller: parameter without effect: command_interfaces: velocity") == 1
    with pytest.raises(ControllersFileError, match=r"'position' is missing in \[velocity\]: use \[position\]"):
        load(tmp_path, PLAIN.replace("command_interfaces: [position]", "command_interfaces: [velocity]"))


def test_an_outdated_type_is_reported_and_other_controllers_are_loaded(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    old = "joint_state_controller/JointStateController"
    file = load(tmp_path, PLAIN.replace("joint_state_broadcaster/JointStateBroadcaster", old))
    assert [one.name for one in file.controllers] == ["arm_controller", "hand_controller"]
    assert f"its type {old} is outdated: use joint_state_broadcaster/JointStateBroadcaster" in caplog.text


@pytest.mark.parametrize("named", ["    hand_controller: {}\n", ""])
def test_the_type_may_be_in_the_controllers_own_section(tmp_path: Path, named: str) -> None:
    text = PLAIN.replace(f"    hand_controller:\n      type: {HAND_TYPE}\n", named)
    text = text.replace("    joints: [right]", f"    type: {HAND_TYPE}\n    joints: [right]")
    assert [(one.name, one.kind) for one in load(tmp_path, text).controllers][-1] == ("hand_controller", HAND_TYPE)


def with_entry(line: str) -> str:
    return PLAIN.replace(f"{HAND_TYPE}\n", f"{HAND_TYPE}\n      {line}\n")


def test_parameter_files_and_arguments_in_the_controllers_file_work_as_from_a_spawner(tmp_path: Path) -> None:
    more = tmp_path / "more.yaml"
    more.write_text("hand_controller: {ros__parameters: {command_timeout: 7.5, joints: [joint1]}}")
    entry = f"params_file: {more}\n      node_options_args: ['-p', 'joints:=[joint2]', '-r', 'a:=b']"
    hand = load(tmp_path, with_entry(entry)).controllers[-1]
    assert hand.parameters.model_dump()["command_timeout"] == 7.5
    assert hand.parameters.claims() == ("joint2/position",)
    assert hand.node_arguments == ("--ros-args", "-p", "joints:=[joint2]", "-r", "a:=b")


@pytest.mark.parametrize(
    ("line", "says"),
    [
        (
            "params_file: nowhere.yaml",
            ":9: controller_manager.hand_controller cannot be loaded: cannot read now",
        ),
        (
            "node_options_args: ['-p', 'a:=[']",
            ":9: controller_manager.hand_controller cannot be loaded: hand_contr",
        ),
        ("fallback_controllers: [nope]", ":11: controller_manager.hand_controller.fallback_controllers names nope"),
        ("fallback_controllers: hand_controller", "fallback_controllers names hand_controller, which is not another"),
    ],
)
def test_mistakes_in_the_managers_section_are_reported(tmp_path: Path, line: str, says: str) -> None:
    with pytest.raises(ControllersFileError) as error:
        load(tmp_path, with_entry(line))
    assert says in str(error.value)


@pytest.mark.parametrize("line", ["params_file: {}", "node_options_args: ['--params-file', '{}']"])
def test_a_parameter_file_that_is_too_large_is_rejected(tmp_path: Path, line: str) -> None:
    more = tmp_path / "more.yaml"
    with more.open("wb") as file:
        file.truncate(LARGEST_BYTES + 1)
    with pytest.raises(ControllersFileError, match=r"more.yaml is larger than 2 MB: shorten it"):
        load(tmp_path, with_entry(line.format(more)))


def test_an_impossible_parameter_file_name_is_left_to_rcl(tmp_path: Path) -> None:
    line = f"node_options_args: ['--params-file', '{'x' * 1000}']"
    assert load(tmp_path, with_entry(line)).controllers[-1].node_arguments[1] == "--params-file"


def test_manager_parameters_without_effect_are_logged(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    lines = "update_rate: 20\n    cpu_affinity: 3\n    overruns: {manage: true}\n    use_sim_time: false"
    load(tmp_path, PLAIN.replace("update_rate: 20", lines))
    assert "controllers.yaml:5: controller_manager: parameter without effect: cpu_affinity\n" in caplog.text
    assert "controllers.yaml:6: controller_manager: parameter without effect: overruns\n" in caplog.text
