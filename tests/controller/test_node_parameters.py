from typing import Any

import pytest

from controller.manager.node_parameters import merged, parameters_in, parameters_of


@pytest.mark.parametrize(
    ("arguments", "found"),
    [
        (["--ros-args", "-p", "goal_time:=2"], {"goal_time": 2}),
        (["-p", "constraints.goal_time:=2.5"], {"constraints": {"goal_time": 2.5}}),
        (["--param", "joints:=[a, b]", "-r", "x:=y"], {"joints": ["a", "b"]}),
        (["-p", "arm:x:=1", "-p", "/arm:y:=2", "-p", "/**:z:=3", "-p", "hand:x:=4"], {"x": 1, "y": 2, "z": 3}),
        (["-p", "x:=1", "-p", "x:=2"], {"x": 2}),
        (["-p", "no value"], {}),
        (["-p"], {}),
        ([], {}),
    ],
)
def test_parameters_are_read_from_ros_arguments(arguments: list[str], found: dict[str, Any]) -> None:
    assert parameters_in(arguments, "arm") == found


def test_an_argument_with_invalid_yaml_is_reported() -> None:
    with pytest.raises(ValueError, match=r"arm: the value in the argument '-p joints:=\[a' is not valid YAML"):
        parameters_in(["-p", "joints:=[a"], "arm")


@pytest.mark.parametrize(
    ("first", "second", "both"),
    [
        ({"a": 1}, {"b": 2}, {"a": 1, "b": 2}),
        ({"a": {"b": 1, "c": 2}}, {"a": {"b": 3}}, {"a": {"b": 3, "c": 2}}),
        ({"a": {"b": 1, "c": 2}}, {"a.b": 3, "a.d.e": 4}, {"a": {"b": 3, "c": 2, "d": {"e": 4}}}),
        ({"a": [1, 2]}, {"a": [3]}, {"a": [3]}),
        ({"a": 1}, {"a": {"b": 2}}, {"a": {"b": 2}}),
        ({}, {"a.b": 1}, {"a": {"b": 1}}),
    ],
)
def test_parameters_are_merged_recursively(first: dict[str, Any], second: dict[str, Any], both: dict[str, Any]) -> None:
    before = repr(first)
    assert merged(first, second) == both
    assert repr(first) == before


def test_parameters_of_all_nodes_are_merged_with_those_of_one_node() -> None:
    content = {
        "/**": {"ros__parameters": {"constraints": {"goal_time": 1.0, "stopped_velocity_tolerance": 0.1}}},
        "arm": {"ros__parameters": {"constraints": {"goal_time": 2.0}}},
    }
    assert parameters_of(content, "arm") == {"constraints": {"goal_time": 2.0, "stopped_velocity_tolerance": 0.1}}
