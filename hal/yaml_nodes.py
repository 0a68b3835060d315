"""Read YAML files as nodes with line numbers and as plain values.

Launch files use this module, so it depends only on PyYAML.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final

import yaml

from hal.text_file import read_text
from hal.yaml_limits import TooDeep, TooLarge, check_expanded, check_size

_FASTEST: Final[type[yaml.SafeLoader]] = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""The C loader if PyYAML was built with it (about eight times as fast), and otherwise the Python loader."""
MOST_MISTAKES: Final = 50
"""Maximum number of errors listed in a message."""
_BAD_VALUES: Final = (ValueError, LookupError, ArithmeticError, AttributeError, TypeError)
"""Errors that PyYAML raises for a value that does not match its tag, such as ``!!bool maybe``."""


class Loader(_FASTEST):  # type: ignore[misc, valid-type]
    """A YAML loader that reports the line of a value that does not match its tag."""

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        """Construct the value of a node. Raises yaml.constructor.ConstructorError."""
        try:
            return super().construct_object(node, deep)
        except _BAD_VALUES as error:
            text = f" '{node.value[:50]}'" if isinstance(node, yaml.ScalarNode) else ""
            kind = node.tag.rpartition(":")[2]
            raise yaml.constructor.ConstructorError(
                problem=f"the value{text} is not a valid {kind}", problem_mark=node.start_mark
            ) from error


@dataclass(frozen=True, slots=True)
class YamlFile:
    """A YAML file as a tree of nodes with line numbers."""

    path: Path
    root: yaml.Node | None
    aliases: Sequence[int] = ()
    """Line numbers of the aliases in the file."""
    _entries: dict[int, dict[str, list[tuple[int, yaml.Node]]]] = field(default_factory=dict)
    """Cache of lines and values, keyed by key name, for each mapping that ``line`` has searched."""

    def place(self, location: Sequence[int | str]) -> str:
        """Return ``path:line`` of the innermost part of ``location`` that exists in the file."""
        return f"{self.path}:{self.line(location)}"

    def line(self, location: Sequence[int | str]) -> int:
        """Return the line of the innermost part of ``location`` that exists in the file."""
        return max(self._reached(self.root, tuple(map(str, location)), 0, 1))[1]

    def _reached(
        self, node: yaml.Node | None, location: tuple[str, ...], depth: int, line: int
    ) -> Iterator[tuple[int, int]]:
        """Yield the depth and line of every match along ``location``. Parameter files may contain the same node name
        several times."""
        yield depth, line
        if not location:
            return
        if isinstance(node, yaml.MappingNode):
            found = self._entries_of(node).get(location[0], ())
            for start, value in found:
                yield from self._reached(value, location[1:], depth + 1, start)
            if not found and any(value.value == location[0] for _, value in node.value):
                # Pydantic adds the discriminator of a union to the location. The discriminator is the value of a key,
                # not a key.
                yield from self._reached(node, location[1:], depth, line)
        elif isinstance(node, yaml.SequenceNode) and location[0].isdecimal() and int(location[0]) < len(node.value):
            part = node.value[int(location[0])]
            yield from self._reached(part, location[1:], depth + 1, part.start_mark.line + 1)

    def _entries_of(self, node: yaml.MappingNode) -> dict[str, list[tuple[int, yaml.Node]]]:
        if id(node) not in self._entries:
            entries = self._entries.setdefault(id(node), {})
            for key, value in node.value:
                entries.setdefault(str(key.value), []).append((key.start_mark.line + 1, value))
        return self._entries[id(node)]


def compose(path: Path, error: type[Exception]) -> YamlFile:
    """Read a file as nodes. Raises ``error`` if the file is not YAML, is too large or is nested too deeply."""
    text = read_text(path, error)
    try:
        aliases = check_size(yaml.parse(text, Loader=Loader))
        root = Loader(text).get_single_node()
        check_expanded(root)
    except yaml.YAMLError as reason:
        raise error(f"{path} is not YAML: {_problem(reason, text)}: correct this line") from reason
    except TooLarge as reason:
        raise error(f"{path} {reason}") from reason
    except TooDeep as reason:
        raise error(
            f"{path}:{reason}: the file contains itself or is nested too deeply: "
            "replace aliases (*) with the values that they refer to"
        ) from reason
    return YamlFile(path, root, aliases)


def read(path: Path, error: type[Exception]) -> tuple[YamlFile, Any]:
    """Read a file both as nodes and as values. Raises ``error`` in the same cases as ``compose``, and for a duplicate
    key."""
    file = compose(path, error)
    duplicates = list(_duplicates(file.root))  # must be called before the constructor, which expands merge keys (<<)
    try:
        content = None if file.root is None else Loader("").construct_document(file.root)
    except yaml.YAMLError as reason:
        raise error(f"{path} is not YAML: {_problem(reason)}: correct this line") from reason
    if duplicates:
        raise error("\n".join(listed([f"{path}:{duplicate}" for duplicate in duplicates])))
    return file, content


def listed(lines: Sequence[str | partial[str]]) -> list[str]:
    """Return the first ``MOST_MISTAKES`` lines, followed by a line with the number of omitted errors."""
    shown = [line if isinstance(line, str) else line() for line in lines[:MOST_MISTAKES]]
    more = len(lines) - len(shown)
    return [*shown, f"and {more} more errors"] if more else shown


def _problem(error: yaml.YAMLError, text: str = "") -> str:
    """Return the parser's message with the line number, as one line. ``text`` is the content of the file."""
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark is not None:
        context = f"{error.context}: " if error.context else ""
        return f"{context}{error.problem} (line {error.problem_mark.line + 1})"
    if isinstance(error, yaml.reader.ReaderError):
        line = text.encode().count(b"\n", 0, error.position) + 1
        return f"the character U+{error.character:04X} is not allowed (line {line})"
    return " ".join(str(error).split())


def _duplicates(node: yaml.Node | None) -> Iterator[str]:
    """Yield a message for each duplicate key in a mapping. By itself, PyYAML would silently use the last value."""
    if isinstance(node, yaml.SequenceNode):
        for item in node.value:
            yield from _duplicates(item)
    if isinstance(node, yaml.MappingNode):
        first: dict[str, int] = {}
        for key, value in node.value:
            name, line = str(key.value), key.start_mark.line + 1
            if name in first:
                yield f"{line}: duplicate key {name} (first in line {first[name]}): remove one"
            first.setdefault(name, line)
            yield from _duplicates(value)
