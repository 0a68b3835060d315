"""YAML files as models: all mistakes of a file at once, each with file and line."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Protocol, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from hal.yaml_nodes import YamlFile, listed, read

Model = TypeVar("Model", bound=BaseModel)


class Places(Protocol):
    """The places of a file's values."""

    def place(self, location: Sequence[int | str]) -> str:
        """File and line of the innermost part of ``location`` that the file has."""


def load(path: Path, model: type[Model], error: type[Exception]) -> Model:
    """Read ``path`` as ``model``. Raises ``error`` whose text lists every mistake with its line."""
    return load_with_lines(path, model, error)[0]


def load_with_lines(path: Path, model: type[Model], error: type[Exception]) -> tuple[Model, YamlFile]:
    """Read ``path`` as ``model``, and as a file that knows its lines. Raises ``error`` as ``load`` does."""
    file, content = read(path, error)
    try:
        return model.model_validate(content), file
    except ValidationError as reason:
        raise error("\n".join(mistakes(file, reason))) from reason


def mistakes(file: Places, error: ValidationError, within: Sequence[int | str] = (), name: str = "") -> list[str]:
    """Each mistake of a model, with file and line. ``within``: where the model's values are; ``name``: their owner."""
    return listed([partial(_mistake, file, item, within, name) for item in error.errors(include_url=False)])


def said(item: ErrorDetails) -> str:
    """Pydantic's message, without the class of our own errors, and with the remedy for a missing pair of quotes."""
    value = item["input"]
    if item["type"] == "string_type" and isinstance(value, bool):
        return f"{str(value).lower()} is a truth value here: put the text in quotes"
    if item["type"] == "string_type" and isinstance(value, int | float):
        return f"{value} is a number here: put the text in quotes ('{value}')"
    return item["msg"].removeprefix("Value error, ")


def _mistake(file: Places, item: ErrorDetails, within: Sequence[int | str], name: str) -> str:
    names = [name] if name else []
    return f"{file.place((*within, *item['loc']))}: {'.'.join([*names, *map(str, item['loc'])])}: {said(item)}"
