"""ros2_control's own file: what it makes, and every mistake in it at once, in words."""

from pathlib import Path
from typing import Any, cast

import pytest
from pydantic import ValidationError

from controller.broadcasters.joint_state_broadcaster import JointStateBroadcaster
from controller.forward.forward_command_controller import ForwardCommandController
from controller.interface import ControllerContext
from controller.manager.controller_spec import ControllerSpec
from controller.manager.controllers_file import (
    ControllersFile,
    ControllersFileError,
    load_controller,
    load_controllers_file,
)
from controller.manager.factory import Factory
from controller.manager.manager import ControllerManager
from controller.manager.settings import Settings
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from hal.file_size import LARGEST_BYTES
from hal.robot_description.description import Description, HardwareInfo, parse_urdf
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


def test_the_plain_file_works_and_the_robot_files_defaults_fill_it_in(tmp_path: Path) -> None:
    file = load(tmp_path, PLAIN, DEFAULTS)
    assert file.update_rate_hz == 20
    assert [c.name for c in file.controllers] == ["joint_state_broadcaster", "arm_controller", "hand_controller"]
    arm = arm_of(file)
    assert arm.joints == ("joint1", "joint2")
    assert arm.parameters.allow_nonzero_velocity_at_trajectory_end
    assert arm.parameters.wait_for == ("hand_controller",)
    assert (arm.parameters.wait_for_timeout, arm.parameters.command_lead) == (0.7, 0.01)


def test_without_defaults_it_does_what_upstream_does(tmp_path: Path) -> None:
    parameters = arm_of(load(tmp_path, PLAIN)).parameters
    assert (parameters.wait_for, parameters.command_lead) == ((), None)
    assert not any((*parameters.tolerances().path.values(), *parameters.tolerances().goal.values()))
    assert parameters.tolerances().goal_time_s == 0.0


def test_the_file_wins_over_the_defaults(tmp_path: Path) -> None:
    own = PLAIN.replace("    joints: [joint1", "    wait_for: []\n    joints: [joint1")
    assert arm_of(load(tmp_path, own, DEFAULTS)).parameters.wait_for == ()


def test_defaults_may_name_a_controller_that_the_file_has_not(tmp_path: Path) -> None:
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


def test_upstreams_update_rate_is_the_default(tmp_path: Path) -> None:
    assert load(tmp_path, PLAIN.replace("    update_rate: 20\n", "")).update_rate_hz == 100


def test_parameters_of_upstream_that_are_not_used_are_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    load(tmp_path, PLAIN.replace("    state_interfaces", "    open_loop_control: true\n    state_interfaces", 1))
    assert "arm_controller: not used: open_loop_control" in caplog.text


MISTAKES = {
    "an unknown joint": (
        ("[joint1, joint2]", "[joint1, joint7]"),
        ["arm_controller.joints names joint7, which takes no commands in the URDF's <ros2_control> block"],
    ),
    "a joint without command interface": (
        ("[right]", "[left]"),
        ["hand_controller.joints names left, which takes no commands"],
    ),
    "a joint twice": (("[joint1, joint2]", "[joint1, joint1]"), ["arm_controller.joints names joint1 twice"]),
    "an unknown type": (
        (ARM_TYPE, "diff_drive_controller/DiffDriveController"),
        ["arm_controller has unknown type 'diff_drive_controller/DiffDriveController', known types are " + ARM_TYPE],
    ),
    "a name that no ROS node can have": (
        ("    hand_controller:\n", "    hand-2:\n"),
        ["hand-2 cannot be a controller's name: ROS nodes' names are letters, digits and _, and begin with no digit"],
    ),
    "no joints": (("[joint1, joint2]", "[]"), ["arm_controller.joints: "]),
    "joints forgotten": (("    joints: [right]\n", ""), ["hand_controller.joints: Field required"]),
    "joints of the wrong kind": (("[right]", "7"), ["hand_controller.joints: "]),
    "an interface that we have not": (
        ("interface_name: position", "interface_name: effort"),
        ["hand_controller.joints wants right/effort, which is no command_interface of the URDF's <ros2_control> block"],
    ),
    "a rate of zero": (("update_rate: 20", "update_rate: 0"), ["controller_manager.update_rate: "]),
    "a rate beyond reason": (("update_rate: 20", "update_rate: 100000"), ["controller_manager.update_rate: "]),
    "a rate in words": (("update_rate: 20", "update_rate: fast"), ["controller_manager.update_rate: "]),
    "a negative lead": (
        ("    joints: [joint1", "    command_lead: -0.1\n    joints: [joint1"),
        ["arm_controller.command_lead: "],
    ),
    "a wait for ever": (
        ("    joints: [joint1", "    wait_for_timeout: .inf\n    joints: [joint1"),
        ["arm_controller.wait_for_timeout: "],
    ),
    "a wait for nobody": (
        ("    joints: [joint1", "    wait_for: [hand_controler]\n    joints: [joint1"),
        ["arm_controller.wait_for names hand_controler, which is no other controller of this file"],
    ),
    "a wait for itself": (
        ("    joints: [joint1", "    wait_for: [arm_controller]\n    joints: [joint1"),
        ["arm_controller.wait_for names arm_controller, which is no other controller of this file"],
    ),
    "a negative tolerance": (
        ("    joints: [joint1", "    constraints: {joint1: {goal: -0.1}}\n    joints: [joint1"),
        ["arm_controller.constraints.joint1.goal: "],
    ),
    "a tolerance in words": (
        ("    joints: [joint1", "    constraints: {joint1: wide}\n    joints: [joint1"),
        ["arm_controller.constraints.joint1: "],
    ),
    "a method that we have not": (
        ("    joints: [joint1", "    interpolation_method: cubic\n    joints: [joint1"),
        ["arm_controller.interpolation_method: Input should be 'splines', 'none' or 'ruckig'"],
    ),
}


@pytest.mark.parametrize(("change", "texts"), MISTAKES.values(), ids=MISTAKES.keys())
def test_each_mistake_is_said_with_the_files_name(tmp_path: Path, change: tuple[str, str], texts: list[str]) -> None:
    assert change[0] in PLAIN
    with pytest.raises(ControllersFileError) as error:
        load(tmp_path, PLAIN.replace(*change, 1))
    lines = str(error.value).splitlines()
    assert len(lines) == len(texts)
    for line, text in zip(lines, texts, strict=True):
        assert line.startswith(f"{tmp_path / 'controllers.yaml'}")
        assert text in line


def test_all_mistakes_come_at_once(tmp_path: Path) -> None:
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
        ("controller_manager:\n  ros__parameters: 7", "controllers.yaml:2: controller_manager.ros__parameters: "),
    ],
    ids=["no manager", "bad YAML", "a list", "empty", "parameters are a number"],
)
def test_a_file_of_the_wrong_shape(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ControllersFileError, match=message):
        load(tmp_path, text)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    missing = tmp_path / "missing.yaml"
    with pytest.raises(ControllersFileError, match=r"cannot read .*missing\.yaml: No such file"):
        load_controllers_file(missing, {}, description()[1])


def test_several_may_want_a_joint_because_one_at_a_time_has_it(tmp_path: Path) -> None:
    file = load(tmp_path, PLAIN.replace("[right]", "[right, joint2]"))
    assert len(file.controllers) == 3


def test_a_spawner_may_bring_all_controllers(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    file = load(tmp_path, "controller_manager: {ros__parameters: {update_rate: 20, overruns: {manage: true}}}")
    assert file.controllers == ()
    assert "controller_manager names no controllers: a spawner has to bring them" in caplog.text


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


def test_patterns_and_slashes_count_as_for_ros(tmp_path: Path) -> None:
    hand, other, _ = load(tmp_path, SAID_OF_ALL).controllers
    assert (hand.parameters.claims(), other.parameters.claims()) == (("joint2/position",), ("joint1/position",))
    assert (hand.fallback, other.fallback) == (("spare",), ("spare",))


# What a spawner brings later


def spec(tmp_path: Path, name: str, kind: str, *texts: str) -> ControllerSpec:
    paths = []
    for number, text in enumerate(texts):
        paths.append(tmp_path / f"more{number}.yaml")
        paths[-1].write_text(text)
    file = load(tmp_path, PLAIN, DEFAULTS)
    return load_controller(file, name, Settings(kind, tuple(paths)), description()[1])


def test_a_controller_that_the_file_has_not(tmp_path: Path) -> None:
    text = "wrist: {ros__parameters: {type: ignored/Here, joints: [joint2], interface_name: position}}"
    made = spec(tmp_path, "wrist", HAND_TYPE, text)
    assert (made.name, made.kind, made.parameters.claims()) == ("wrist", HAND_TYPE, ("joint2/position",))
    assert made.parameters.unused() == []


def test_a_spawner_may_leave_required_parameters_for_later(tmp_path: Path) -> None:
    made = spec(tmp_path, "wrist", HAND_TYPE, "wrist: {ros__parameters: {joints: [joint2], command_timeout: 2.0}}")
    assert made.parameters.missing() == ("interface_name",)
    with pytest.raises(ValueError, match="wrist lacks interface_name: set it on its node /wrist"):
        Factory(load(tmp_path, PLAIN, DEFAULTS), cast(Any, None)).make(made)
    later = made.parameters.as_far_as_given(
        {**made.parameters.model_dump(warnings=False), "interface_name": "position"}
    )
    assert (later.missing(), later.claims()) == ((), ("joint2/position",))
    with pytest.raises(ValidationError, match="command_timeout"):
        made.parameters.as_far_as_given({"joints": ["joint2"], "command_timeout": -1.0})


def test_the_fallback_of_the_controllers_file_stays(tmp_path: Path) -> None:
    path = tmp_path / "controllers.yaml"
    path.write_text(PLAIN.replace(f"{ARM_TYPE}\n", f"{ARM_TYPE}\n      fallback_controllers: [hand_controller]\n"))
    more = tmp_path / "more.yaml"
    more.write_text("arm_controller: {ros__parameters: {joints: [joint1]}}")
    file = load_controllers_file(path, {}, description()[1])
    made = load_controller(file, "arm_controller", Settings(ARM_TYPE, (more,)), description()[1])
    assert (made.fallback, made.parameters.claims()) == (("hand_controller",), ("joint1/position",))


def test_later_files_count_more_and_the_controllers_file_and_defaults_least(tmp_path: Path) -> None:
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
            "controller_manager.wrist has unknown type 'no/Such', known",
        ),
        (
            "wrist",
            HAND_TYPE,
            "hand: {ros__parameters: {}}",
            "more0.yaml says nothing of wrist: give it a section 'wrist: ",
        ),
        (
            "wrist",
            HAND_TYPE,
            "wrist: {ros__parameters: {joints: [], interface_name: smell}}",
            "more0.yaml:1: wrist.interface_name: Input should be",
        ),
        ("wrist", HAND_TYPE, "wrist: [", "more0.yaml is not YAML"),
        (
            "wrist",
            HAND_TYPE,
            "wrist:\n  ros__parameters:\n    interface_name: position\n    joints: [joint9]",
            "more0.yaml:4: wrist.joints names joint9, which takes no commands",
        ),
    ],
)
def test_mistakes_of_a_spawner_are_said_with_the_file(
    tmp_path: Path, name: str, kind: str, text: str, said: str
) -> None:
    with pytest.raises(ControllersFileError) as error:
        spec(tmp_path, name, kind, text)
    assert said in str(error.value)


def test_the_house_files_are_right() -> None:
    from servoloop.files import read_files

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
        ("'': 1", ":15: arm_controller. has an empty name: give the parameter a name"),
        ("own: {'': 1}", ":15: arm_controller.own. has an empty name"),
        ("own..part: 1", "arm_controller.own. has an empty name"),
        ("own: [1, 2.0]", ":15: arm_controller.own mixes float and int in one list: write all in the same way"),
        ("own: [[1, 2]]", ":15: arm_controller.own has a list or a mapping within a list, which no"),
        ("own: [{a: 1}]", ":15: arm_controller.own has a list or a mapping within a list, which no"),
        ("own:", ":15: arm_controller.own has no value"),
    ],
)
def test_what_no_ros_parameter_can_be_is_refused(tmp_path: Path, line: str, says: str) -> None:
    text = PLAIN.replace("    state_interfaces:", f"    {line}\n    state_interfaces:")
    with pytest.raises(ControllersFileError) as error:
        load(tmp_path, text)
    assert says in str(error.value)


def test_defaults_of_a_robot_file_are_checked_likewise(tmp_path: Path) -> None:
    with pytest.raises(ControllersFileError, match=r"arm_controller\. has an empty name"):
        load(tmp_path, PLAIN, {"arm_controller": {"": 1}})


def test_joints_whose_names_are_numbers_are_to_be_put_in_quotes(tmp_path: Path) -> None:
    with pytest.raises(ControllersFileError) as error:
        load(tmp_path, PLAIN.replace("[joint1, joint2]", "[1, 2]"))
    assert ":13: arm_controller.joints.0: 1 is read as a number: put the text in quotes ('1')" in str(error.value)


def test_a_list_of_command_interfaces_with_position_uses_position(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    file = load(tmp_path, PLAIN.replace("command_interfaces: [position]", "command_interfaces: [position, velocity]"))
    assert file.controllers[1].parameters.claims() == ("joint1/position", "joint2/position")
    assert caplog.text.count("arm_controller: not used: command_interfaces: velocity") == 1
    with pytest.raises(ControllersFileError, match=r"'position' is not among velocity: write \[position\]"):
        load(tmp_path, PLAIN.replace("command_interfaces: [position]", "command_interfaces: [velocity]"))


def test_an_outdated_type_is_named_and_the_others_are_loaded(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    old = "joint_state_controller/JointStateController"
    file = load(tmp_path, PLAIN.replace("joint_state_broadcaster/JointStateBroadcaster", old))
    assert [one.name for one in file.controllers] == ["arm_controller", "hand_controller"]
    assert f"its type {old} is outdated: write joint_state_broadcaster/JointStateBroadcaster" in caplog.text


@pytest.mark.parametrize("named", ["    hand_controller: {}\n", ""])
def test_a_type_may_be_in_the_controllers_own_section(tmp_path: Path, named: str) -> None:
    text = PLAIN.replace(f"    hand_controller:\n      type: {HAND_TYPE}\n", named)
    text = text.replace("    joints: [right]", f"    type: {HAND_TYPE}\n    joints: [right]")
    assert [(one.name, one.kind) for one in load(tmp_path, text).controllers][-1] == ("hand_controller", HAND_TYPE)


def with_entry(line: str) -> str:
    return PLAIN.replace(f"{HAND_TYPE}\n", f"{HAND_TYPE}\n      {line}\n")


def test_parameter_files_and_arguments_of_the_entry_count_as_the_spawners(tmp_path: Path) -> None:
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
        ("fallback_controllers: hand_controller", "fallback_controllers names hand_controller, which is no other"),
    ],
)
def test_mistakes_in_an_entry_of_the_manager(tmp_path: Path, line: str, says: str) -> None:
    with pytest.raises(ControllersFileError) as error:
        load(tmp_path, with_entry(line))
    assert says in str(error.value)


@pytest.mark.parametrize("line", ["params_file: {}", "node_options_args: ['--params-file', '{}']"])
def test_a_large_parameter_file_that_the_file_names_is_refused(tmp_path: Path, line: str) -> None:
    more = tmp_path / "more.yaml"
    with more.open("wb") as file:
        file.truncate(LARGEST_BYTES + 1)
    with pytest.raises(ControllersFileError, match=r"more.yaml is larger than 2 MB: shorten it"):
        load(tmp_path, with_entry(line.format(more)))


def test_a_parameter_file_with_a_name_that_no_file_can_have_is_left_to_rcl(tmp_path: Path) -> None:
    line = f"node_options_args: ['--params-file', '{'x' * 1000}']"
    assert load(tmp_path, with_entry(line)).controllers[-1].node_arguments[1] == "--params-file"


def test_the_managers_parameters_without_effect_are_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    lines = "update_rate: 20\n    cpu_affinity: 3\n    overruns: {manage: true}\n    use_sim_time: false"
    load(tmp_path, PLAIN.replace("update_rate: 20", lines))
    assert "controller_manager: not used: cpu_affinity, overruns" in caplog.text
