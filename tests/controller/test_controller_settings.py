"""Test that settings have the same effect in the controllers file, in a service call and from the spawner."""

from pathlib import Path
from typing import Any, cast

import pytest

from controller.interface import ControllerContext
from controller.manager.controller_spec import ControllerSpec
from controller.manager.factory import Factory
from controller.manager.settings import ManagerSettings, setting_mistake
from controller.manager_errors import ControllersFileError
from tests.controller.test_controllers_file import HAND_TYPE, PLAIN, description, load

MORE = "hand_controller: {ros__parameters: {command_timeout: 7.5, joints: [joint1]}}"
ARGUMENTS = ["-p", "joints:=[joint2]", "-r", "a:=b"]
HERE = {"type": HAND_TYPE}


def in_the_entry(settings: dict[str, Any]) -> str:
    """Return a controllers file with the settings in the manager's section."""
    lines = "".join(f"\n      {key}: {value}" for key, value in settings.items())
    return PLAIN.replace(f"    hand_controller:\n      type: {HAND_TYPE}", f"    hand_controller:{lines}")


def in_its_section(settings: dict[str, Any]) -> str:
    """Return a controllers file with the settings in the controller's own section."""
    lines = "".join(f"    {key}: {value}\n" for key, value in settings.items())
    text = PLAIN.replace(f"    hand_controller:\n      type: {HAND_TYPE}\n", "    hand_controller: {}\n")
    return text.replace("    joints: [right]\n", f"    joints: [right]\n{lines}")


def loaded(tmp_path: Path, text: str, settings: ManagerSettings | None = None) -> ControllerSpec:
    """Return the hand's spec that a service call creates with this controllers file."""
    context = ControllerContext(*description(), {}, lambda name: True)
    return Factory(load(tmp_path, text), cast(Any, context)).spec("hand_controller", settings or ManagerSettings())


@pytest.fixture(params=["a list", "a text"])
def settings(request: pytest.FixtureRequest, tmp_path: Path) -> dict[str, Any]:
    more = tmp_path / "more.yaml"
    more.write_text(MORE)
    lists = request.param == "a list"
    return {
        "type": HAND_TYPE,
        "params_file": [str(more)] if lists else str(more),
        "node_options_args": ARGUMENTS if lists else f"'{' '.join(ARGUMENTS)}'",
        "fallback_controllers": ["arm_controller"] if lists else "arm_controller",
    }


def test_settings_have_the_same_effect_from_every_source(settings: dict[str, Any], tmp_path: Path) -> None:
    entry, section = in_the_entry(settings), in_its_section(settings)
    asked = ManagerSettings.of(settings | {"node_options_args": ARGUMENTS})
    specs = [
        load(tmp_path, entry).controllers[-1],
        load(tmp_path, section).controllers[-1],
        loaded(tmp_path, entry),
        loaded(tmp_path, section),
        loaded(tmp_path, PLAIN, asked),
    ]
    for spec in specs:
        assert spec == specs[0]
    assert specs[0].parameters.model_dump()["command_timeout"] == 7.5
    assert specs[0].parameters.claims() == ("joint2/position",)
    assert specs[0].node_arguments == ("--ros-args", *ARGUMENTS)
    assert specs[0].fallback == ("arm_controller",)


def test_the_settings_of_a_client_override_those_of_the_file(tmp_path: Path) -> None:
    text = in_the_entry({"type": HAND_TYPE, "node_options_args": ARGUMENTS})
    spec = loaded(tmp_path, text, ManagerSettings(node_arguments=("-p", "joints:=[joint1]")))
    assert spec.parameters.claims() == ("joint1/position",)
    assert spec.node_arguments == ("--ros-args", "-p", "joints:=[joint1]")


def test_a_controller_without_a_type_is_not_loaded(tmp_path: Path) -> None:
    context = ControllerContext(*description(), {}, lambda name: True)
    factory = Factory(load(tmp_path, PLAIN), cast(Any, context))
    with pytest.raises(ControllersFileError, match=r"^The 'type' param was not defined for 'elbow': set elbow.type on"):
        factory.spec("elbow", ManagerSettings())


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("type", "5"),
        ("type", ".nan"),
        ("type", "[a/B]"),
        ("params_file", "5"),
        ("params_file", "[1, 2]"),
        ("fallback_controllers", "true"),
        ("node_options_args", "2.5"),
    ],
)
@pytest.mark.parametrize("written", [in_the_entry, in_its_section])
def test_a_setting_that_is_not_a_string_is_reported_with_its_line(
    name: str, value: str, written: Any, tmp_path: Path
) -> None:
    with pytest.raises(ControllersFileError) as error:
        load(tmp_path, written(HERE | {name: value}))
    (line,) = [line for line in str(error.value).splitlines() if f"hand_controller.{name} is " in line]
    number = int(line.removeprefix(f"{tmp_path}/controllers.yaml:").partition(":")[0])
    assert f"{name}: {value}" in (tmp_path / "controllers.yaml").read_text().splitlines()[number - 1]


def test_a_long_value_is_cut_in_the_message() -> None:
    assert len(setting_mistake("type", ["x" * 1_000_000])) < 1_000
