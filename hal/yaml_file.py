"""YAML with line numbers: all mistakes of a file at once, each with file and line."""

from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar

import yaml
from pydantic import BaseModel, ValidationError

Model = TypeVar("Model", bound=BaseModel)


def load(path: Path, model: type[Model], error: type[Exception]) -> Model:
    """Read ``path`` as ``model``. Raises ``error`` whose text lists every mistake with its line."""
    try:
        text = path.read_text()
    except OSError as reason:
        raise error(f"cannot read {path}: {reason.strerror}") from reason
    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
        content = yaml.safe_load(text)
    except yaml.YAMLError as reason:
        raise error(f"{path} is not YAML: {reason}") from reason
    try:
        return model.model_validate(content)
    except ValidationError as reason:
        lines = [
            f"{path}:{_line(root, item['loc'])}: {'.'.join(map(str, item['loc']))}: {item['msg']}"
            for item in reason.errors()
        ]
        raise error("\n".join(lines)) from reason


def _line(node: yaml.Node | None, location: Sequence[int | str]) -> int:
    """The line of the innermost node of ``location`` that the file has."""
    line = 1
    for key in location:
        if isinstance(node, yaml.MappingNode):
            found = [(k, v) for k, v in node.value if k.value == str(key)]
            if not found:
                return line
            line, node = found[0][0].start_mark.line + 1, found[0][1]
        elif isinstance(node, yaml.SequenceNode) and isinstance(key, int):
            node = node.value[key]
            line = node.start_mark.line + 1
    return line
