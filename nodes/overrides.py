"""Find the parameters that files and arguments set for a node, and report those that have no effect."""

from collections.abc import Iterator, Sequence
from typing import Final

from rclpy.node import Node

from controller.manager.node_parameters import files_in

_OF_RCLPY: Final = ("use_sim_time", "start_type_description_service", "qos_overrides.")


def undeclare_overrides(node: Node) -> set[str]:
    """Undeclare the parameters that were set by files and arguments, and return their names. The node then declares the
    parameters that it knows.

    The node must be created with ``automatically_declare_parameters_from_overrides``, because rclpy offers no other way
    to list the overrides.
    """
    given = {name for name in node.get_parameters_by_prefix("") if not name.startswith(_OF_RCLPY)}
    for name in given:
        node.undeclare_parameter(name)
    return given


def unused(node: Node, given: set[str], arguments: Sequence[str]) -> Iterator[str]:
    """Yield warnings about unknown parameters and about files that contain no parameters for this node."""
    for name in sorted(name for name in given if not node.has_parameter(name)):
        yield f"parameter '{name}' is ignored: this node has no parameter with that name"
    files = files_in(arguments)
    if files and not given:
        listed = ", ".join(map(str, files))
        yield f"{listed} contains no parameters for {node.get_fully_qualified_name()}: using the defaults"
