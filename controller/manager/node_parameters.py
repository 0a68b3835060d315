"""The parameters of one node in ROS parameter files, by upstream's rules of which entry counts."""

import re
from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

from controller.manager.parameter_file import ALL, PARAMETERS, parse_value

Content = Mapping[str, Mapping[str, Any]]
"""A file's nodes (or patterns of nodes) in its order, below each ``ros__parameters``."""


def parameters_of(content: Content, node: str) -> dict[str, Any]:
    """The parameters of ``node``, which is in no namespace: as in rclcpp, later entries of a file count more."""
    found: dict[str, Any] = {}
    for pattern, said in content.items():
        if _matches(pattern, node):
            found = merged(found, said.get(PARAMETERS) or {})
    return found


@lru_cache(4096)
def _matches(pattern: str, node: str) -> bool:
    """Whether rclcpp takes a name with the wildcards ``*`` and ``**`` for this node."""
    absolute = pattern if pattern.startswith("/") else f"/{pattern}"
    return re.fullmatch(absolute.replace("/*", r"(/\w+)"), f"/{node}") is not None


def parameters_in(arguments: Sequence[str], node: str) -> dict[str, Any]:
    """The parameters of ``node`` in ROS arguments: ``-p name:=value``, or ``-p node:name:=value`` for one node only.

    Raises ValueError where a value is no YAML.
    """
    found: dict[str, Any] = {}
    for flag, rule in pairwise(arguments):
        name, given, value = rule.partition(":=")
        whose, _, name = name.rpartition(":")
        if flag in ("-p", "--param") and given and whose in ("", node, f"/{node}", ALL):
            try:
                found = merged(found, {name: parse_value(value)})
            except ValueError as error:
                raise ValueError(f"{node} gets the argument '{flag} {rule}', whose value is no YAML") from error
    return found


def files_in(arguments: Sequence[str]) -> list[Path]:
    """The parameter files that ROS arguments name, which rcl reads."""
    return [Path(value) for flag, value in pairwise(arguments) if flag == "--params-file"]


def merged(first: Mapping[str, Any], second: Mapping[str, Any]) -> dict[str, Any]:
    """Both groups merged, where ``second`` counts more: name by name also within a group, also of names with dots."""
    found = dict(first)
    for key, value in second.items():
        group, _, rest = str(key).partition(".")
        value = {rest: value} if rest else value
        within = found.get(group)
        if isinstance(value, Mapping):
            value = merged(within if isinstance(within, Mapping) else {}, value)
        found[group] = value
    return found


def names(content: Content, node: str) -> bool:
    """Whether the file says anything of this very node."""
    return any(pattern.rpartition("/")[2] == node and _matches(pattern, node) for pattern in content)
