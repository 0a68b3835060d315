"""The parameters of one node in ROS parameter files, by upstream's rules of which entry counts."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel, ConfigDict, RootModel, ValidationError

from hal.yaml_file import YamlFile, mistakes, read

ALL = "/**"
PARAMETERS = "ros__parameters"

Content = Mapping[str, Mapping[str, Any]]
"""A file as it is: node names (or patterns), below them ``ros__parameters``."""


class _Node(BaseModel):
    model_config = ConfigDict(extra="allow")
    ros__parameters: dict[str, Any] = {}


class _File(RootModel[dict[str, _Node]]):
    pass


def read_content(path: Path, error: type[Exception]) -> tuple[YamlFile, Content]:
    """The whole file. Raises ``error`` with every mistake in its shape."""
    file, content = read(path, error)
    try:
        return file, _File.model_validate(content).model_dump()
    except ValidationError as reason:
        raise error("\n".join(mistakes(file, reason))) from reason


def parameters_of(content: Content, node: str) -> dict[str, Any]:
    """The parameters of ``node``, which is in no namespace: entries for it alone win over entries for all nodes."""
    general = content.get(ALL, {})
    found = merged({}, general.get(PARAMETERS, {}))
    for said in (general.get(node), content.get(f"{ALL}/{node}"), content.get(node), content.get(f"/{node}")):
        if isinstance(said, Mapping):
            found = merged(found, said.get(PARAMETERS) or {})
    return found


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
                found = merged(found, {name: yaml.safe_load(value)})
            except yaml.YAMLError as error:
                raise ValueError(f"{node} gets the argument '{flag} {rule}', whose value is no YAML") from error
    return found


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
    return any(name in content for name in (node, f"/{node}", f"{ALL}/{node}")) or node in content.get(ALL, {})
