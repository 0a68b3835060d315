"""Read ROS parameter files using rcl's rules for node names and value types."""

import logging
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import yaml

from hal.yaml_limits import TooDeep, TooLarge, check_size
from hal.yaml_nodes import Loader, YamlFile, compose, listed

LOG = logging.getLogger("servoloop.controller")

ALL: Final = "/**"
PARAMETERS: Final = "ros__parameters"
MOST_NODES: Final = 300
"""Maximum number of nodes and node patterns in one file."""
MOST_VALUES: Final = 2000
"""Maximum number of values per node. Each entry of a list counts as one value."""
_RESOLVER: Final[Any] = Loader("")
_NODE: Final = re.compile(r"(/?(\*\*|\*|[A-Za-z_][A-Za-z0-9_]*))(/(\*\*|\*|[A-Za-z_][A-Za-z0-9_]*))*")
_TEXT: Final = "tag:yaml.org,2002:str"
_TRUE: Final = {"Y", "y", "yes", "Yes", "YES", "true", "True", "TRUE", "on", "On", "ON"}
_FALSE: Final = {"N", "n", "no", "No", "NO", "false", "False", "FALSE", "off", "Off", "OFF"}
_INTEGER: Final = re.compile(r"[+-]?(0[xX][0-9a-fA-F]+|[0-9]+)")
_FLOAT: Final = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
_NOT_FINITE: Final = re.compile(r"[+-]?\.?(inf|nan)|[+-]?infinity", re.IGNORECASE)


class _TooMany(Exception):
    """The file contains too many nodes or values. The message is appended to the file name."""


@dataclass(slots=True)
class _Reader:
    """Reader for one parameter file, which collects the parameters of each node and the errors."""

    file: YamlFile
    content: dict[str, dict[str, Any]] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    _values: dict[str, int] = field(default_factory=dict)
    """Number of values of each node, keyed by node name."""
    _lines: dict[str, int] = field(default_factory=dict)
    """Line of each value, keyed by its path."""

    def report(self, node: yaml.Node, text: str) -> None:
        self.problems.append(f"{self.file.path}:{node.start_mark.line + 1}: {text}")

    def nodes(self, mapping: yaml.Node, within: str = "") -> None:
        """Read a mapping of node names, namespaces or ``ros__parameters``. ``within`` is the path of parent names."""
        for key, value, name in self._entries(mapping, within, "node"):
            if name == PARAMETERS:
                self._node(key, value, within)
            elif isinstance(value, yaml.MappingNode):
                self.nodes(value, f"{within}/{name}" if within else name)
            else:
                path = f"{within}.{name}" if within else name
                self.report(key, f"{path} is outside {PARAMETERS}: move the value below '{PARAMETERS}:'")

    def _node(self, key: yaml.Node, value: yaml.Node, name: str) -> None:
        """Read the parameters of one node, and merge them with earlier parameters of the same node."""
        if not _NODE.fullmatch(name):
            self.report(key, f"'{name}' is not a valid node name: put the name of a node above {PARAMETERS}")
        elif not isinstance(value, yaml.MappingNode):
            self.report(key, f"{name}.{PARAMETERS} is not a mapping: list parameters by name, or remove the section")
        else:
            known = self.content.setdefault(name, {PARAMETERS: {}})
            self._count(value, name)
            self._parameters(value, known[PARAMETERS], name)

    def _count(self, parameters: yaml.Node, name: str) -> None:
        """Count the values of a node. Raises _TooMany."""
        line = parameters.start_mark.line + 1
        if len(self.content) > MOST_NODES:
            raise _TooMany(f":{line}: the file has more than {MOST_NODES} nodes: split the file")
        self._values[name] = self._values.get(name, 0) + sum(1 for _ in _scalars(parameters))
        if self._values[name] > MOST_VALUES:
            raise _TooMany(f":{line}: {name} has more than {MOST_VALUES} values: shorten its lists")

    def _parameters(self, mapping: yaml.Node, found: dict[str, Any], path: str) -> None:
        for key, value, name in self._entries(mapping, path, "parameter"):
            where = f"{path}.{name}"
            if isinstance(value, yaml.MappingNode):
                group = found.get(name)
                found[name] = group if isinstance(group, dict) else {}
                self._parameters(value, found[name], where)
            else:
                self._log_duplicate(key, where)
                found[name] = self.value(value, where)

    def _log_duplicate(self, key: yaml.Node, where: str) -> None:
        first, line = self._lines.get(where), key.start_mark.line + 1
        self._lines[where] = line
        if first is not None:
            text = "%s:%d: %s replaces the value in line %d, as in rcl: remove one of them"
            LOG.warning(text, self.file.path, line, where, first)

    def value(self, node: yaml.Node, where: str) -> Any:
        """Return the value of the parameter named ``where``: a scalar or a list of scalars."""
        return self._list(node, where) if isinstance(node, yaml.SequenceNode) else self._scalar(node, where)

    def _entries(self, mapping: yaml.Node, path: str, kind: str) -> Iterator[tuple[yaml.Node, yaml.Node, str]]:
        for key, value in mapping.value:
            if not isinstance(key, yaml.ScalarNode):
                self.report(key, "a list or a mapping cannot be a key: use a name")
            elif not key.value:
                self.report(key, f"{path or 'the file'} has a {kind} without a name: give the {kind} a name")
            else:
                yield key, value, key.value

    def _list(self, sequence: yaml.SequenceNode, where: str) -> list[Any]:
        values = [self._scalar(part, where) for part in sequence.value]
        kinds = sorted({type(value).__name__ for value in values})
        if len(kinds) > 1:
            mixed = " and ".join(kinds)
            remedy = "use one type for all elements, for example 0.0 instead of 0"
            self.report(sequence, f"{where} mixes {mixed} in one list: {remedy}")
        return values

    def _scalar(self, node: yaml.Node, where: str) -> Any:
        if not isinstance(node, yaml.ScalarNode):
            self.report(node, f"{where} has a list or a mapping within a list: ROS parameters do not support this")
            return ""
        if not node.value and not node.style:
            self.report(node, f"{where} has no value: set a value or remove the parameter")
        return scalar(node)


def _scalars(node: yaml.Node) -> Iterator[yaml.Node]:
    """Yield the scalar values within a mapping or a list."""
    if isinstance(node, yaml.MappingNode | yaml.SequenceNode):
        for part in node.value:
            yield from _scalars(part[1] if isinstance(part, tuple) else part)
    else:
        yield node


def scalar(node: yaml.ScalarNode) -> bool | int | float | str:
    """Return a value with the type that rcl assigns: quoted values are strings, and ``1e3`` is a number."""
    text = str(node.value)
    if node.style in ("'", '"') or _tagged_as_text(node):
        return text
    if text in _TRUE or text in _FALSE:
        return text in _TRUE
    if (number := _integer(text)) is not None:
        return number
    if _FLOAT.fullmatch(text):
        return float(text) if math.isfinite(float(text)) else text  # rcl reads an out-of-range number as a string.
    return float(text.replace(".", "")) if _NOT_FINITE.fullmatch(text) else text


def _tagged_as_text(node: yaml.ScalarNode) -> bool:
    """Return whether a ``!!str`` tag turns a value that would otherwise have another type into a string."""
    return bool(node.tag == _TEXT and _RESOLVER.resolve(yaml.ScalarNode, node.value, (True, False)) != _TEXT)


def _integer(text: str) -> int | None:
    """Parse a 64-bit integer, or return None. As in C, a number with a leading 0 is octal."""
    if not _INTEGER.fullmatch(text) or len(text) > 30:
        return None
    digits = text.lstrip("+-")
    octal = len(digits) > 1 and digits.isdecimal() and digits[0] == "0"
    if octal and not set(digits) <= set("01234567"):
        return None
    number = int(digits, 8 if octal else 0) * (-1 if text[0] == "-" else 1)
    return number if -(2**63) <= number < 2**63 else None


def parse_value(text: str) -> Any:
    """Parse a value in the same way as rcl parses the value in ``-p name:=value``. Raises ValueError."""
    try:
        aliases = check_size(yaml.parse(text, Loader=Loader))
        root = Loader(text).get_single_node()
    except (yaml.YAMLError, TooLarge, TooDeep) as error:
        raise ValueError("the value is not valid YAML") from error
    reader = _Reader(YamlFile(Path("-p"), root))
    value = None if root is None or aliases else reader.value(root, "it")
    if value is None or reader.problems:
        raise ValueError("the value must be a scalar or a list of scalars of one type")
    return value


def read_parameter_file(path: Path, error: type[Exception]) -> tuple[YamlFile, dict[str, dict[str, Any]]]:
    """Read a ROS parameter file.

    Args:
        path: Path of the file.
        error: Type of the exception to raise.

    Returns:
        The YAML file, and the ``ros__parameters`` of each node (``arm``, ``/ns/arm``, ``/**``) in file order.

    Raises:
        error: The file contains errors because of which rcl would also reject it. The message lists all errors with
            their line numbers.
    """
    file = compose(path, error)
    reader = _Reader(file)
    reader.problems += [
        f"{path}:{line}: an alias (*) is not supported in parameter files: replace the alias with its value"
        for line in file.aliases
    ]
    if isinstance(file.root, yaml.MappingNode):
        try:
            reader.nodes(file.root)
        except _TooMany as reason:
            raise error(f"{path}{reason}") from reason
    else:
        reader.problems.append(f"{path}:1: the file is not a mapping: start with the name of a node and {PARAMETERS}")
    if reader.problems:
        raise error("\n".join(listed(reader.problems)))
    return file, reader.content
