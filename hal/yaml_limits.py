"""Limits on the number of values, the nesting depth and the aliases of a YAML file, so that reading it takes only a few
seconds."""

from collections.abc import Iterable
from typing import Final

import yaml

MOST_VALUES: Final = 150_000
"""Maximum number of keys and values in a file after its aliases have been expanded."""
DEEPEST: Final = 100
"""Maximum nesting depth of mappings and lists."""
_STARTS: Final = (yaml.MappingStartEvent, yaml.SequenceStartEvent)
_ENDS: Final = (yaml.MappingEndEvent, yaml.SequenceEndEvent)


class TooLarge(Exception):
    """The file has too many values. The message completes a sentence that starts with the file name."""


class TooDeep(Exception):
    """Values are nested too deeply or contain themselves. The message contains only the line number."""


def check_size(events: Iterable[yaml.Event]) -> list[int]:
    """Check the number of values and the depth of a document before its nodes are built.

    Returns:
        Line numbers of the aliases in the document.

    Raises:
        TooLarge: The document has too many values.
        TooDeep: The document is nested too deeply.
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
    """Check the number of values and the depth of a document after its aliases have been expanded. Raises TooLarge or
    TooDeep."""
    if root is not None and _counted(root, {}, DEEPEST)[0] > MOST_VALUES:
        raise TooLarge(f"has more than {MOST_VALUES} values after its aliases (*) are expanded: shorten it")


def _counted(node: yaml.Node, known: dict[int, tuple[int, int]], allowed: int) -> tuple[int, int]:
    """Return the number of values in a node and the node's depth.

    Args:
        node: The node.
        known: Results for nodes that have already been counted, keyed by ID of the node object.
        allowed: Maximum depth.
    """
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
