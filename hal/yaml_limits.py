"""Limits of YAML files, so that none takes more than a few seconds: number of values, depth and aliases."""

from collections.abc import Iterable
from typing import Final

import yaml

MOST_VALUES: Final = 150_000
"""Maximum number of keys and values of a file, with what its aliases stand for."""
DEEPEST: Final = 100
"""Maximum depth of mappings and lists within each other."""
_STARTS: Final = (yaml.MappingStartEvent, yaml.SequenceStartEvent)
_ENDS: Final = (yaml.MappingEndEvent, yaml.SequenceEndEvent)


class TooLarge(Exception):
    """The file has more values than any file of an arm. The text follows the file's name."""


class TooDeep(Exception):
    """Values are nested too deeply, or within themselves. The text is the line."""


def check_size(events: Iterable[yaml.Event]) -> list[int]:
    """Count a document's values before nodes are made of them; returns the lines of its aliases.

    Raises TooLarge or TooDeep.
    """
    values = depth = 0
    aliases: list[int] = []
    for event in events:
        values += isinstance(event, yaml.NodeEvent)
        if isinstance(event, yaml.AliasEvent) and event.start_mark is not None:
            aliases.append(event.start_mark.line + 1)
        depth += isinstance(event, _STARTS) - isinstance(event, _ENDS)
        if depth > DEEPEST:
            raise TooDeep(event.start_mark.line + 1 if event.start_mark else 1)
        if values > MOST_VALUES:
            raise TooLarge(f"has more than {MOST_VALUES} values: shorten it, or choose another file")
    return aliases


def check_expanded(root: yaml.Node | None) -> None:
    """Count a document's values with what its aliases stand for. Raises TooLarge or TooDeep."""
    if root is not None and _counted(root, {}, DEEPEST)[0] > MOST_VALUES:
        raise TooLarge(
            f"has more than {MOST_VALUES} values, counted with those that its aliases (*) stand for: shorten it"
        )


def _counted(node: yaml.Node, known: dict[int, tuple[int, int]], allowed: int) -> tuple[int, int]:
    """Number of values in ``node`` and its depth, at most ``allowed``. ``known``: those of nodes that were counted."""
    if allowed < 0:
        raise TooDeep(node.start_mark.line + 1)
    if id(node) not in known:
        parts: list[yaml.Node] = []
        if isinstance(node, yaml.SequenceNode):
            parts = node.value
        elif isinstance(node, yaml.MappingNode):
            parts = [part for pair in node.value for part in pair]
        counts = [_counted(part, known, allowed - 1) for part in parts]
        known[id(node)] = 1 + sum(c for c, _ in counts), 1 + max((d for _, d in counts), default=-1)
    if known[id(node)][1] > allowed:
        raise TooDeep(node.start_mark.line + 1)
    return known[id(node)]
