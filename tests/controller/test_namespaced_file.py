"""Tests of controllers files of stacks in a namespace: which sections apply, and where mistakes are reported."""

from pathlib import Path

import pytest

from controller.manager.controllers_file import ControllersFile, load_controller, load_controllers_file
from controller.manager.sections import Sections
from controller.manager.settings import ManagerSettings
from controller.manager_errors import ControllersFileError
from tests.controller.test_controllers_file import ARM_TYPE, HAND_TYPE, PLAIN, description

TWO_ARMS = f"""
/**/controller_manager:
  ros__parameters:
    update_rate: 20
    arm_controller:
      type: {ARM_TYPE}
/**:
  arm_controller:
    ros__parameters: {{joints: [joint1, joint2], command_interfaces: [position], state_interfaces: [position]}}
left:
  arm_controller:
    ros__parameters: {{joints: [joint1]}}
/right/arm_controller:
  ros__parameters:
    joints: [joint2]
/left/robot_state_publisher: {{ros__parameters: {{frame_prefix: l_}}}}
"""
IN_LEFT = PLAIN.replace("\ncontroller_manager:", "\n/left/controller_manager:")


def load(tmp_path: Path, text: str, namespace: str) -> ControllersFile:
    path = tmp_path / "controllers.yaml"
    path.write_text(text)
    return load_controllers_file(path, {}, description()[1], namespace=namespace)


def claims(file: ControllersFile) -> dict[str, tuple[str, ...]]:
    return {spec.name: spec.parameters.claims() for spec in file.controllers}


@pytest.mark.parametrize(
    ("namespace", "joints"),
    [
        ("/left", ["joint1"]),
        ("/right", ["joint2"]),
        ("", ["joint1", "joint2"]),
        ("/lab/left", ["joint1", "joint2"]),
    ],
)
def test_each_namespace_has_its_own_parameters(tmp_path: Path, namespace: str, joints: list[str]) -> None:
    file = load(tmp_path, TWO_ARMS, namespace)
    assert claims(file) == {"arm_controller": tuple(f"{joint}/position" for joint in joints)}
    assert file.parameters("robot_state_publisher") == ({"frame_prefix": "l_"} if namespace == "/left" else {})
    assert file.namespace == namespace


def test_a_file_without_namespaces_serves_every_stack(tmp_path: Path) -> None:
    assert claims(load(tmp_path, PLAIN, "/left")) == claims(load(tmp_path, PLAIN, ""))


def test_a_section_of_the_root_is_not_for_a_manager_in_a_namespace(tmp_path: Path) -> None:
    with pytest.raises(
        ControllersFileError, match=r":11: this section is for /arm_controller, but .* /left/arm_c.* or /\*\*/arm_c"
    ):
        load(tmp_path, IN_LEFT, "/left")


def test_a_file_for_another_namespace_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        ControllersFileError,
        match=r"has no /right/controller_manager section: rename /left/controller_manager or use its n",
    ):
        load(tmp_path, IN_LEFT, "/right")


def test_sections_with_a_type_are_controllers_of_their_namespace(tmp_path: Path) -> None:
    text = (
        TWO_ARMS + f"/left/hand: {{ros__parameters: {{type: {HAND_TYPE}, joints: [right], interface_name: position}}}}"
    )
    assert [spec.name for spec in load(tmp_path, text, "/left").controllers] == ["arm_controller", "hand"]
    assert [spec.name for spec in load(tmp_path, text, "/right").controllers] == ["arm_controller"]


@pytest.mark.parametrize(
    ("section", "line"), [("/left/arm_controller", 5), ("left: {arm_controller", 5), ("/**: {arm_controller", 5)]
)
def test_mistakes_are_found_in_namespaced_sections(tmp_path: Path, section: str, line: int) -> None:
    close = "}" if "{" in section else ""
    text = f"""/**/controller_manager: {{ros__parameters: {{arm_controller: {{type: {ARM_TYPE}}}}}}}
/**/arm_controller: {{ros__parameters: {{joints: [joint1], state_interfaces: [position]}}}}
{section}: {{ros__parameters: {{
    joints: [joint1, joint2],
    command_interfaces: [force]}}}}{close}
"""
    with pytest.raises(ControllersFileError, match=rf"controllers.yaml:{line}: arm_controller\.command_interfaces"):
        load(tmp_path, text, "/left")


def test_a_spawner_gives_files_and_arguments_for_the_namespace(tmp_path: Path) -> None:
    file, more = load(tmp_path, TWO_ARMS, "/left"), tmp_path / "more.yaml"
    text = "{{{}/hand: {{ros__parameters: {{joints: [{}], interface_name: position}}}}}}"
    settings = ManagerSettings(HAND_TYPE, (more,), node_arguments=("-p", "hand:joints:=[no]", "-p", "/left/hand:a:=1"))
    for namespace, joint in (("/left", "right"), ("/**", "joint1")):
        more.write_text(text.format(namespace, joint))
        spec = load_controller(file, "hand", settings, description()[1])
        assert spec.parameters.claims() == (f"{joint}/position",)
    more.write_text("hand: {ros__parameters: {joints: [right], interface_name: position}}")
    with pytest.raises(ControllersFileError, match=r"no section for /left/hand: add '/left/hand: ros__parameters: "):
        load_controller(file, "hand", settings, description()[1])


def test_places_prefer_the_section_that_is_deepest(tmp_path: Path) -> None:
    path = tmp_path / "file.yaml"
    path.write_text("arm: {ros__parameters: {a: 1}}\nleft:\n  arm:\n    ros__parameters:\n      a: 2\n")
    sections = Sections.read(path, "/left", ControllersFileError)
    assert sections.place(("arm", "ros__parameters", "a")) == f"{path}:5"
    assert Sections.read(path, "", ControllersFileError).place(("arm", "ros__parameters", "a")) == f"{path}:1"
