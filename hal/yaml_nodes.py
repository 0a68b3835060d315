"""YAML as nodes, which know their lines, and as plain values. Only PyYAML is needed: launch files read so, too."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final

import yaml

from hal.text_file import read_text
from hal.yaml_limits import TooDeep, TooLarge, check_expanded, check_size

_FASTEST: Final[type[yaml.SafeLoader]] = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""The loader in C, which is about eight times as fast, if PyYAML was built with it."""
MOST_MISTAKES: Final = 50
"""Number of mistakes that are listed one by one."""
_BAD_VALUES: Final = (ValueError, LookupError, ArithmeticError, AttributeError, TypeError)
"""Errors of PyYAML's constructors for a value that does not fit its tag, such as ``!!bool maybe``."""


class Loader(_FASTEST):  # type: ignore[misc, valid-type]
    """A loader that names the line of a value that does not fit its tag."""

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        """Make the value of a node. Raises yaml.constructor.ConstructorError."""
        try:
            return super().construct_object(node, deep)
        except _BAD_VALUES as error:
            text = f" '{node.value[:50]}'" if isinstance(node, yaml.ScalarNode) else ""
            kind = node.tag.rpartition(":")[2]
            raise yaml.constructor.ConstructorError(
                problem=f"the value{text} cannot be of the type {kind}", problem_mark=node.start_mark
            ) from error


@dataclass(frozen=True, slots=True)
class YamlFile:
    """A YAML file as its nodes, which know their lines."""

    path: Path
    root: yaml.Node | None
    aliases: Sequence[int] = ()
    """The lines of its aliases."""
    _entries: dict[int, dict[str, list[tuple[int, yaml.Node]]]] = field(default_factory=dict)
    """Lines and values by key, of each mapping in which ``line`` has searched."""

    def place(self, location: Sequence[int | str]) -> str:
        """``path:line`` of the innermost part of ``location`` that the file has."""
        return f"{self.path}:{self.line(location)}"

    def line(self, location: Sequence[int | str]) -> int:
        """The line of the innermost part of ``location`` that the file has."""
        return max(self._reached(self.root, tuple(map(str, location)), 0, 1))[1]

    def _reached(
        self, node: yaml.Node | None, location: tuple[str, ...], depth: int, line: int
    ) -> Iterator[tuple[int, int]]:
        """Yields depth and line of each way along ``location``: parameter files may name a node several times."""
        yield depth, line
        if not location:
            return
        if isinstance(node, yaml.MappingNode):
            found = self._entries_of(node).get(location[0], ())
            for start, value in found:
                yield from self._reached(value, location[1:], depth + 1, start)
            if not found and any(value.value == location[0] for _, value in node.value):
                # A location also names what kind of thing the mapping is, which is the value of one of its keys.
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
    """Read a file as nodes. Raises ``error`` if it is not YAML, or larger or deeper than any file of an arm."""
    text = read_text(path, error)
    try:
        aliases = check_size(yaml.parse(text, Loader=Loader))
        root = Loader(text).get_single_node()
        check_expanded(root)
    except yaml.YAMLError as reason:
        raise error(f"{path} is not YAML: {_problem(reason, text)}: correct it") from reason
    except TooLarge as reason:
        raise error(f"{path} {reason}") from reason
    except TooDeep as reason:
        raise error(
            f"{path}:{reason}: the file contains itself, or is nested too deeply: "
            "write out what an alias (*) stands for"
        ) from reason
    return YamlFile(path, root, aliases)


def read(path: Path, error: type[Exception]) -> tuple[YamlFile, Any]:
    """Read a file as nodes and as values. Raises ``error`` also if a key stands twice in one mapping."""
    file = compose(path, error)
    doubles = list(_doubles(file.root))  # before merge keys (<<) are replaced by what they stand for
    try:
        content = None if file.root is None else Loader("").construct_document(file.root)
    except yaml.YAMLError as reason:
        raise error(f"{path} is not YAML: {_problem(reason)}: correct it") from reason
    if doubles:
        raise error("\n".join(listed([f"{path}:{double}" for double in doubles])))
    return file, content


def listed(lines: Sequence[str | partial[str]]) -> list[str]:
    """The first lines, and how many more there are."""
    shown = [line if isinstance(line, str) else line() for line in lines[:MOST_MISTAKES]]
    more = len(lines) - len(shown)
    return [*shown, f"and {more} more mistakes"] if more else shown


def _problem(error: yaml.YAMLError, text: str = "") -> str:
    """The parser's words with the line, on one line. ``text``: the file's."""
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark is not None:
        context = f"{error.context}: " if error.context else ""
        return f"{context}{error.problem} (line {error.problem_mark.line + 1})"
    if isinstance(error, yaml.reader.ReaderError):
        line = text.encode().count(b"\n", 0, error.position) + 1
        return f"the character U+{error.character:04X} is not allowed (line {line})"
    return " ".join(str(error).split())


def _doubles(node: yaml.Node | None) -> Iterator[str]:
    """Keys that stand twice in one mapping: YAML would quietly take the last."""
    if isinstance(node, yaml.SequenceNode):
        for item in node.value:
            yield from _doubles(item)
    if isinstance(node, yaml.MappingNode):
        first: dict[str, int] = {}
        for key, value in node.value:
            name, line = str(key.value), key.start_mark.line + 1
            if name in first:
                yield f"{line}: {name} stands here for the second time, first in line {first[name]}"
            first.setdefault(name, line)
            yield from _doubles(value)
