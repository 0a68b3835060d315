"""Namespaces that a user names: which are accepted, and what rcl makes of them."""

import pytest

from drivers.errors import DriverError
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
