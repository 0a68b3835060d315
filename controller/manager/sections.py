"""Read the sections of a parameter file that apply to the nodes of one namespace, and find the line of each value."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from controller.manager.node_parameters import Content, matches, merged, named, parameters_of
from controller.manager.parameter_file import ALL, PARAMETERS, read_parameter_file
from hal.yaml_file import YamlPlaces
from hal.yaml_nodes import YamlFile

MANAGER: Final = "controller_manager"


@dataclass(frozen=True, slots=True)
class Sections:
    """The sections of a file that apply to the nodes of one namespace."""

    file: YamlFile
    content: Content
    namespace: str = ""
    """Absolute namespace, such as ``/left``; empty for the root namespace."""

    @classmethod
    def read(cls, path: Path, namespace: str, error: type[Exception]) -> "Sections":
        """Read a parameter file. Raises ``error`` with a message that lists all errors."""
        return cls(*read_parameter_file(path, error), namespace)

    def of(self, node: str) -> dict[str, Any]:
        """Return the parameters of a node."""
        return parameters_of(self.content, f"{self.namespace}/{node}")

    def has(self, node: str) -> bool:
        """Return whether the file has a section with the name of this node, not only a matching wildcard."""
        return named(self.content, f"{self.namespace}/{node}")

    def concerns(self, node: str) -> bool:
        """Return whether the file has a section for this node or for all nodes."""
        return self.has(node) or ALL in self.content

    def elsewhere(self, node: str) -> bool:
        """Return whether this node's name appears only in sections of the root namespace."""
        return bool(self.namespace) and not self.has(node) and named(self.content, f"/{node}")

    def nodes(self) -> Iterator[str]:
        """Yield the names of all nodes in this namespace that have a section, in file order."""
        for pattern in self.content:
            name = pattern.rpartition("/")[2]
            if name.isidentifier() and self.has(name):
                yield name

    def place(self, location: Sequence[int | str]) -> str:
        """Return the file and line of a value. The location starts with the name of a node.

        A controller without a section has the place of its name in the manager's section.
        """
        node, *rest = location
        places = self._places(str(node), rest) or self._places(MANAGER, (PARAMETERS, node))
        return self.file.place(max([location, *places], key=self.file.line))

    def _places(self, node: str, rest: Sequence[int | str]) -> list[tuple[int | str, ...]]:
        patterns = [pattern for pattern in self.content if matches(pattern, f"{self.namespace}/{node}")]
        return [(*keys, *rest) for pattern in patterns for keys in _spellings(pattern)]


@dataclass(frozen=True, slots=True)
class SectionsWithDefaults:
    """Lookup for the line of a parameter. Default values are stored in a different file."""

    sections: Sections
    defaults: YamlPlaces
    key: str
    """Key under which the default values are stored in their file."""
    values: Mapping[str, Mapping[str, Any]]
    """Default values, keyed by node."""

    def place(self, location: Sequence[int | str]) -> str:
        """Return the file and line of a value, as ``Sections.place`` does."""
        node, _, *keys = location
        own, default = self.sections.of(str(node)), merged({}, self.values.get(str(node), {}))
        if keys and str(keys[0]) not in own and str(keys[0]) in default:
            return self.defaults.place((self.key, node, *keys))
        return self.sections.place(location)


def _spellings(pattern: str) -> Iterator[tuple[str, ...]]:
    """Yield the key paths under which a file can contain this pattern: one key, or nested keys split at one or every
    slash."""
    yield (pattern,)
    for at, letter in enumerate(pattern):
        if letter == "/" and at:
            yield (pattern[:at], pattern[at + 1 :])
    yield tuple(pattern.split("/"))
