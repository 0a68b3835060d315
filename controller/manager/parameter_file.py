"""ROS parameter files, read as rcl reads them: which nodes they name, and the type of each value."""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import yaml

from hal.yaml_limits import TooDeep, TooLarge, check_size
from hal.yaml_nodes import Loader, YamlFile, compose, listed

ALL: Final = "/**"
PARAMETERS: Final = "ros__parameters"
MOST_NODES: Final = 300
"""Maximum number of nodes, with patterns of nodes, in one file."""
MOST_VALUES: Final = 2000
"""Maximum number of values of one node, each entry of a list counted."""
_RESOLVER: Final[Any] = Loader("")
_NODE: Final = re.compile(r"(/?(\*\*|\*|[A-Za-z_][A-Za-z0-9_]*))(/(\*\*|\*|[A-Za-z_][A-Za-z0-9_]*))*")
_TEXT: Final = "tag:yaml.org,2002:str"
_TRUE: Final = {"Y", "y", "yes", "Yes", "YES", "true", "True", "TRUE", "on", "On", "ON"}
_FALSE: Final = {"N", "n", "no", "No", "NO", "false", "False", "FALSE", "off", "Off", "OFF"}
_INTEGER: Final = re.compile(r"[+-]?(0[xX][0-9a-fA-F]+|[0-9]+)")
_FLOAT: Final = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
_NOT_FINITE: Final = re.compile(r"[+-]?\.?(inf|nan)|[+-]?infinity", re.IGNORECASE)


class _TooMany(Exception):
    """The file has more nodes or values than any robot needs. The text follows the file's name."""


@dataclass(slots=True)
class _Reader:
    """One file being read: the parameters of each node, and the mistakes found so far."""

    file: YamlFile
    content: dict[str, dict[str, Any]] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    _values: dict[str, int] = field(default_factory=dict)
    """The number of values by node."""

    def say(self, node: yaml.Node, text: str) -> None:
        self.problems.append(f"{self.file.path}:{node.start_mark.line + 1}: {text}")

    def nodes(self, mapping: yaml.Node, within: str = "") -> None:
        """Read a mapping of node names, namespaces or ``ros__parameters``; ``within``: the names above it."""
        for key, value, name in self._entries(mapping, within):
            if name == PARAMETERS:
                self._node(key, value, within)
            elif isinstance(value, yaml.MappingNode):
                self.nodes(value, f"{within}/{name}" if within else name)
            else:
                path = f"{within}.{name}" if within else name
                self.say(key, f"{path}: a value stands outside {PARAMETERS}: put it below '{PARAMETERS}:'")

    def _node(self, key: yaml.Node, value: yaml.Node, name: str) -> None:
        """Read the parameters of one node; those of a node that was named before are merged with them."""
        if not _NODE.fullmatch(name):
            self.say(key, f"{name or 'nothing'} is not the name of a node: put a node's name above {PARAMETERS}")
        elif not isinstance(value, yaml.MappingNode):
            self.say(key, f"{name}.{PARAMETERS}: this is not a mapping: list parameters by name, or take it out")
        else:
            known = self.content.setdefault(name, {PARAMETERS: {}})
            self._count(value, name)
            self._parameters(value, known[PARAMETERS], name)

    def _count(self, parameters: yaml.Node, name: str) -> None:
        """Count the values of a node. Raises _TooMany."""
        line = parameters.start_mark.line + 1
        if len(self.content) > MOST_NODES:
            raise _TooMany(f":{line}: the file has more than {MOST_NODES} nodes: split it")
        self._values[name] = self._values.get(name, 0) + sum(1 for _ in _scalars(parameters))
        if self._values[name] > MOST_VALUES:
            raise _TooMany(f":{line}: {name} has more than {MOST_VALUES} values: shorten its lists")

    def _parameters(self, mapping: yaml.Node, found: dict[str, Any], path: str) -> None:
        for _, value, name in self._entries(mapping, path):
            where = f"{path}.{name}"
            if isinstance(value, yaml.MappingNode):
                group = found.get(name)
                found[name] = group if isinstance(group, dict) else {}
                self._parameters(value, found[name], where)
            else:
                found[name] = self.value(value, where)

    def value(self, node: yaml.Node, where: str) -> Any:
        """The value of the parameter ``where``: a scalar or a list of scalars."""
        return self._list(node, where) if isinstance(node, yaml.SequenceNode) else self._scalar(node, where)

    def _entries(self, mapping: yaml.Node, path: str) -> Iterator[tuple[yaml.Node, yaml.Node, str]]:
        for key, value in mapping.value:
            if not isinstance(key, yaml.ScalarNode):
                self.say(key, "a list or a mapping cannot be a key: write a name")
            elif not key.value:
                self.say(key, f"{path}. has an empty name: give the parameter a name")
            else:
                yield key, value, key.value

    def _list(self, sequence: yaml.SequenceNode, where: str) -> list[Any]:
        values = [self._scalar(part, where) for part in sequence.value]
        kinds = sorted({type(value).__name__ for value in values})
        if len(kinds) > 1:
            mixed = " and ".join(kinds)
            self.say(sequence, f"{where} mixes {mixed} in one list: write all in the same way, 0.0 instead of 0")
        return values

    def _scalar(self, node: yaml.Node, where: str) -> Any:
        if not isinstance(node, yaml.ScalarNode):
            self.say(node, f"{where} has a list or a mapping within a list, which no ROS parameter has: take it out")
            return ""
        if not node.value and not node.style:
            self.say(node, f"{where} has no value: give it one, or take it out")
        return scalar(node)


def _scalars(node: yaml.Node) -> Iterator[yaml.Node]:
    """Yields the values within a mapping or a list."""
    if isinstance(node, yaml.MappingNode | yaml.SequenceNode):
        for part in node.value:
            yield from _scalars(part[1] if isinstance(part, tuple) else part)
    else:
        yield node


def scalar(node: yaml.ScalarNode) -> bool | int | float | str:
    """A value with the type that rcl gives it: a quoted one is a text, and ``1e3`` is a number."""
    text = str(node.value)
    if node.style in ("'", '"') or _tagged_as_text(node):
        return text
    if text in _TRUE or text in _FALSE:
        return text in _TRUE
    if (number := _integer(text)) is not None:
        return number
    if _FLOAT.fullmatch(text):
        return float(text) if math.isfinite(float(text)) else text  # in C, a number out of range is none
    return float(text.replace(".", "")) if _NOT_FINITE.fullmatch(text) else text


def _tagged_as_text(node: yaml.ScalarNode) -> bool:
    """Whether ``!!str`` stands before a value that would be of another type without it."""
    return bool(node.tag == _TEXT and _RESOLVER.resolve(yaml.ScalarNode, node.value, (True, False)) != _TEXT)


def _integer(text: str) -> int | None:
    """A whole number of 64 bits; as in C, one that begins with 0 is octal. None for any other text."""
    if not _INTEGER.fullmatch(text) or len(text) > 30:
        return None
    digits = text.lstrip("+-")
    octal = len(digits) > 1 and digits.isdecimal() and digits[0] == "0"
    if octal and not set(digits) <= set("01234567"):
        return None
    number = int(digits, 8 if octal else 0) * (-1 if text[0] == "-" else 1)
    return number if -(2**63) <= number < 2**63 else None


def parse_value(text: str) -> Any:
    """Read one value as rcl reads that of ``-p name:=value``. Raises ValueError."""
    try:
        aliases = check_size(yaml.parse(text, Loader=Loader))
        root = Loader(text).get_single_node()
    except (yaml.YAMLError, TooLarge, TooDeep) as error:
        raise ValueError("it is no YAML") from error
    reader = _Reader(YamlFile(Path("-p"), root))
    value = None if root is None or aliases else reader.value(root, "it")
    if value is None or reader.problems:
        raise ValueError("it is neither a value nor a list of values of one type")
    return value


def read_parameter_file(path: Path, error: type[Exception]) -> tuple[YamlFile, dict[str, dict[str, Any]]]:
    """Read a parameter file: by node (``arm``, ``/ns/arm``, ``/**``) its ``ros__parameters``, in the file's order.

    Raises:
        error: rcl refuses the file, too. The message lists every mistake with its line.
    """
    file = compose(path, error)
    reader = _Reader(file)
    reader.problems += [
        f"{path}:{line}: an alias (*) is not supported in parameter files: write out what it stands for"
        for line in file.aliases
    ]
    if isinstance(file.root, yaml.MappingNode):
        try:
            reader.nodes(file.root)
        except _TooMany as reason:
            raise error(f"{path}{reason}") from reason
    else:
        reader.problems.append(f"{path}:1: this is not a mapping: name a node, and below it {PARAMETERS}")
    if reader.problems:
        raise error("\n".join(listed(reader.problems)))
    return file, reader.content
