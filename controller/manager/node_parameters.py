"""Find the parameters of one node in ROS parameter files, using the same priorities as rclcpp."""

import re
from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

from controller.manager.parameter_file import PARAMETERS, parse_value

Content = Mapping[str, Mapping[str, Any]]
"""The nodes (or node patterns) of a file in file order, each with its ``ros__parameters``."""


def parameters_of(content: Content, node: str) -> dict[str, Any]:
    """Return the parameters of a node. As in rclcpp, later entries in a file take priority.

    A name without a leading slash is in the root namespace, both in the file and in ``node``.
    """
    found: dict[str, Any] = {}
    for pattern, section in content.items():
        if matches(pattern, node):
            found = merged(found, section.get(PARAMETERS) or {})
    return found


@lru_cache(4096)
def matches(pattern: str, node: str) -> bool:
    """Return whether rclcpp matches a pattern with the wildcards ``*`` and ``**`` to this node."""
    return re.fullmatch(_absolute(pattern).replace("/*", r"(/\w+)"), _absolute(node)) is not None


def _absolute(name: str) -> str:
    return name if name.startswith("/") else f"/{name}"


def parameters_in(arguments: Sequence[str], node: str) -> dict[str, Any]:
    """Return a node's parameters from ROS arguments: ``-p name:=value``, or ``-p node:name:=value`` for one node.

    Raises ValueError if a value is not valid YAML.
    """
    found: dict[str, Any] = {}
    for flag, rule in pairwise(arguments):
        name, given, value = rule.partition(":=")
        owner, _, name = name.rpartition(":")
        if flag in ("-p", "--param") and given and (not owner or matches(owner, node)):
            try:
                found = merged(found, {name: parse_value(value)})
            except ValueError as error:
                raise ValueError(f"{node}: the value in the argument '{flag} {rule}' is not valid YAML") from error
    return found


def files_in(arguments: Sequence[str]) -> list[Path]:
    """Return the parameter files that are specified in ROS arguments and read by rcl."""
    return [Path(value) for flag, value in pairwise(arguments) if flag == "--params-file"]


def merged(first: Mapping[str, Any], second: Mapping[str, Any]) -> dict[str, Any]:
    """Merge two parameter groups recursively. ``second`` takes priority, and dots in a name separate groups."""
    found = dict(first)
    for key, value in second.items():
        group, _, rest = str(key).partition(".")
        value = {rest: value} if rest else value
        within = found.get(group)
        if isinstance(value, Mapping):
            value = merged(within if isinstance(within, Mapping) else {}, value)
        found[group] = value
    return found


def named(content: Content, node: str) -> bool:
    """Return whether the file has a section with this node's name, and not only a matching wildcard."""
    name = node.rpartition("/")[2]
    return any(pattern.rpartition("/")[2] == name and matches(pattern, node) for pattern in content)
