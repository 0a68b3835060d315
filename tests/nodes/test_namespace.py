"""Tests of namespaces that a user specifies: which of them are accepted, and how rcl interprets them."""

from pathlib import Path

import pytest

from controller.manager.sections import Sections
from drivers.driver_errors import DriverError
from nodes.namespace import frame_prefix, namespace_arguments, parse_namespace


@pytest.mark.parametrize(
    ("text", "namespace", "prefix"),
    [
        ("left", "/left", "left/"),
        ("/left", "/left", "left/"),
        ("lab_1/left", "/lab_1/left", "lab_1/left/"),
        ("", "", ""),
        ("/", "", ""),
    ],
)
def test_namespaces_are_absolute(text: str, namespace: str, prefix: str) -> None:
    assert (parse_namespace(text), frame_prefix(namespace)) == (namespace, prefix)


@pytest.mark.parametrize("text", ["left arm", "1x", "/left/", "//left", "a//b", "a__b", "lëft", "left-arm", "~/left"])
def test_wrong_namespaces_are_refused_with_the_remedy(text: str) -> None:
    with pytest.raises(DriverError, match=r"is not a namespace: use letters.*such as left or lab/left"):
        parse_namespace(text)


def test_long_namespace_is_refused() -> None:
    assert parse_namespace("a" * 100) == "/" + "a" * 100
    with pytest.raises(DriverError, match=r"^the namespace a+ has 101 characters: shorten it to at most 100$"):
        parse_namespace("a" * 101)


@pytest.mark.parametrize("namespace", ["", "/left", "/lab_1/left"])
def test_rcl_puts_nodes_into_the_namespace(namespace: str) -> None:
    rclpy = pytest.importorskip("rclpy")
    context = rclpy.Context()
    rclpy.init(args=namespace_arguments(namespace), context=context)
    node = rclpy.create_node("arm", context=context)
    try:
        assert node.get_fully_qualified_name() == f"{namespace}/arm"
        assert node.resolve_topic_name("joint_states") == f"{namespace}/joint_states"
    finally:
        node.destroy_node()
        context.try_shutdown()


FILE = """
/**: {arm: {ros__parameters: {a: 1, b: 1, c: 1}}}
arm: {ros__parameters: {a: 2, d: 2}}
left: {arm: {ros__parameters: {b: 3}}, "*": {ros__parameters: {e: 3}}}
/*/arm: {ros__parameters: {c: 4}}
/lab/**: {ros__parameters: {a: 5, f: 5}}
/**/left/arm: {ros__parameters: {g: 6}}
"""


@pytest.mark.parametrize("namespace", ["", "/left", "/lab/left", "/right"])
def test_parameter_files_are_read_as_by_rcl(tmp_path: Path, namespace: str) -> None:
    rclpy, path = pytest.importorskip("rclpy"), tmp_path / "file.yaml"
    path.write_text(FILE)
    context = rclpy.Context()
    rclpy.init(args=["--ros-args", "--params-file", str(path), *namespace_arguments(namespace)], context=context)
    node = rclpy.create_node("arm", context=context, automatically_declare_parameters_from_overrides=True)
    try:
        found = {name: value.value for name, value in node.get_parameters_by_prefix("").items() if len(name) == 1}
    finally:
        node.destroy_node()
        context.try_shutdown()
    assert Sections.read(path, namespace, ValueError).of("arm") == found
    assert found["a"] == (5 if namespace == "/lab/left" else 2 if not namespace else 1)
