"""Test that parameter files are read as in rcl: merging, value types and rejected values."""

from pathlib import Path
from typing import Any

import pytest

from controller.manager.node_parameters import named, parameters_of
from controller.manager.parameter_file import read_parameter_file
from controller.manager_errors import ControllersFileError

NAMED_AGAIN = """
/**:
  arm:
    ros__parameters: {a: 1, group: {b: 2}}
/**:
  ros__parameters: {c: 3}
/**:
  arm:
    ros__parameters: {group: {d: 4}}
"""


def parameters(tmp_path: Path, text: str, node: str = "arm") -> dict[str, Any]:
    path = tmp_path / "file.yaml"
    path.write_text(text)
    return parameters_of(read_parameter_file(path, ControllersFileError)[1], node)


def test_repeated_sections_of_a_node_are_merged(tmp_path: Path) -> None:
    assert parameters(tmp_path, NAMED_AGAIN) == {"a": 1, "group": {"b": 2, "d": 4}, "c": 3}
    assert parameters(tmp_path, NAMED_AGAIN, "hand") == {"c": 3}


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("arm", True),
        ("/arm", True),
        ("/*", True),
        ("/**", True),
        ("/**/arm", True),
        ("/**/*", True),
        ("/ns/arm", False),
        ("/*/arm", False),
        ("hand", False),
    ],
)
def test_wildcards_and_namespaces_match_as_in_rcl(tmp_path: Path, name: str, meant: bool) -> None:
    text = f"{name}: {{ros__parameters: {{a: 1}}}}"
    assert parameters(tmp_path, text) == ({"a": 1} if meant else {})


def test_namespaces_may_be_nested(tmp_path: Path) -> None:
    text = "/**: {ns: {arm: {ros__parameters: {a: 1}}}, arm: {ros__parameters: {b: 2}}}"
    assert parameters(tmp_path, text) == {"b": 2}
    assert named({"/**/arm": {}}, "arm")
    assert not named({"/**": {}}, "arm")


def test_later_entries_override_earlier_ones(tmp_path: Path) -> None:
    text = "arm: {ros__parameters: {a: 1}}\n/**: {ros__parameters: {a: 2}}"
    assert parameters(tmp_path, text) == {"a": 2}


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e3", 1000.0),
        ("010", 8),
        ("0x10", 16),
        ("+5", 5),
        ("1_000", "1_000"),
        ("1:30", "1:30"),
        ("2024-01-01", "2024-01-01"),
        ("yes", True),
        ("n", False),
        ("'1'", "1"),
        ("~", "~"),
        ("-.inf", float("-inf")),
        ("99999999999999999999", 1e20),
        ("[1, 2]", [1, 2]),
        ("[]", []),
        ("!!str 5", "5"),
        ("1e400", "1e400"),
    ],
)
def test_values_have_the_same_types_as_in_rcl(tmp_path: Path, text: str, value: Any) -> None:
    found = parameters(tmp_path, f"arm: {{ros__parameters: {{a: {text}}}}}")["a"]
    assert (type(found), found) == (type(value), value)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("arm:\n  ros_parameters:\n    joints: [a]", ":3: arm/ros_parameters.joints is outside ros__"),
        ("arm:\n  ros__parameters: {a: [0, -0.35]}", ":2: arm.a mixes float and int in one list"),
        ("arm:\n  ros__parameters:\n    a:", ":3: arm.a has no value"),
        ("arm:\n  ros__parameters: 7", ":2: arm.ros__parameters is not a mapping"),
        ("ros__parameters: {a: 1}", ":1: '' is not a valid node name"),
        ("arm: {ros__parameters: {a: &x 1, b: *x}}", ":1: an alias"),
        ("arm: {ros__parameters: {a: [[1]]}}", ":1: arm.a has a list or a mapping within a list"),
        ("arm: {ros__parameters: {'': 1}}", ":1: arm has a parameter without a name: give the parameter a name"),
        ("arm: {'': {ros__parameters: {a: 1}}}", ":1: arm has a node without a name: give the node a name"),
        ("'': {ros__parameters: {a: 1}}", ":1: the file has a node without a name"),
        ("a b: {ros__parameters: {c: 1}}", ":1: 'a b' is not a valid node name"),
        ("? [a]\n: 1", "a list or a mapping cannot be a key"),
        ("", ":1: the file is not a mapping"),
    ],
)
def test_values_that_rcl_rejects_are_rejected_with_their_line(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(ControllersFileError) as error:
        parameters(tmp_path, text)
    assert says in str(error.value)
