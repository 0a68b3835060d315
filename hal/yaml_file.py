"""YAML with line numbers: all mistakes of a file at once, each with file and line."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TypeVar

import yaml
from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

Model = TypeVar("Model", bound=BaseModel)


def load(path: Path, model: type[Model], error: type[Exception]) -> Model:
    """Read ``path`` as ``model``. Raises ``error`` whose text lists every mistake with its line."""
    try:
        text = path.read_text()
    except OSError as reason:
        raise error(f"cannot read {path}: {reason.strerror}") from reason
    except UnicodeDecodeError as reason:
        raise error(f"{path} is not text: {reason}") from reason
    try:
        loader = yaml.SafeLoader(text)
        root = loader.get_single_node()
        doubles = list(_doubles(root))  # before merge keys (<<) are replaced by what they stand for
        content = None if root is None else loader.construct_document(root)
    except yaml.YAMLError as reason:
        raise error(f"{path} is not YAML: {reason}") from reason
    except ValueError as reason:  # of a date, say: it has no line
        raise error(f"{path} has a value that cannot be: {reason}") from reason
    except RecursionError as reason:
        raise error(
            f"{path} contains itself, or is nested too deeply: write out what an alias (*) stands for"
        ) from reason
    if doubles:
        raise error("\n".join(f"{path}:{double}" for double in doubles))
    try:
        return model.model_validate(content)
    except ValidationError as reason:
        lines = [f"{path}:{_line(root, item['loc'])}: {_said(item)}" for item in reason.errors()]
        raise error("\n".join(lines)) from reason


def place(path: Path, location: Sequence[int | str]) -> str:
    """``path:line`` of the innermost part of ``location`` that the file, which has been read before, has."""
    return f"{path}:{_line(yaml.compose(path.read_text(), Loader=yaml.SafeLoader), location)}"


def _said(item: ErrorDetails) -> str:
    return f"{'.'.join(map(str, item['loc']))}: {item['msg'].removeprefix('Value error, ')}"


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


def _line(node: yaml.Node | None, location: Sequence[int | str]) -> int:
    """The line of the innermost node of ``location`` that the file has."""
    line = 1
    for key in location:
        if isinstance(node, yaml.MappingNode):
            found = [(k, v) for k, v in node.value if k.value == str(key)]
            if not found:
                return line
            line, node = found[-1][0].start_mark.line + 1, found[-1][1]
        elif isinstance(node, yaml.SequenceNode) and isinstance(key, int):
            node = node.value[key]
            line = node.start_mark.line + 1
    return line
