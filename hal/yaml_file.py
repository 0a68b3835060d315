"""Read YAML files as pydantic models. All mistakes of a file are reported together, each with file and line."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Protocol, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from hal.yaml_nodes import YamlFile, listed, read

Model = TypeVar("Model", bound=BaseModel)


class YamlPlaces(Protocol):
    """Lookup of the file and line of a value."""

    def place(self, location: Sequence[int | str]) -> str:
        """Return the file and line of the innermost part of ``location`` that exists in the file."""


def load(path: Path, model: type[Model], error: type[Exception]) -> Model:
    """Read a file as a model. Raises ``error`` with a message that lists every mistake and its line."""
    return load_with_lines(path, model, error)[0]


def load_with_lines(path: Path, model: type[Model], error: type[Exception]) -> tuple[Model, YamlFile]:
    """Read a file as a model and as nodes with line numbers. Raises ``error`` as ``load`` does."""
    file, content = read(path, error)
    try:
        return model.model_validate(content), file
    except ValidationError as reason:
        raise error("\n".join(mistakes(file, reason))) from reason


def mistakes(file: YamlPlaces, error: ValidationError, within: Sequence[int | str] = (), name: str = "") -> list[str]:
    """List the mistakes of a model, each with file and line.

    Args:
        file: The file, for the line numbers.
        error: The error that pydantic raised.
        within: Location of the model in the file.
        name: Name that precedes the keys in each message.
    """
    return listed([partial(_mistake, file, item, within, name) for item in error.errors(include_url=False)])


def error_text(item: ErrorDetails) -> str:
    """Return the message of a pydantic error, without the prefix of a ValueError, and with a hint at missing quotes."""
    value = item["input"]
    if item["type"] == "string_type" and isinstance(value, bool):
        return f"{str(value).lower()} is read as a boolean: put the text in quotes"
    if item["type"] == "string_type" and isinstance(value, int | float):
        return f"{value} is read as a number: put the text in quotes ('{value}')"
    return item["msg"].removeprefix("Value error, ")


def _mistake(file: YamlPlaces, item: ErrorDetails, within: Sequence[int | str], name: str) -> str:
    names = [name] if name else []
    return f"{file.place((*within, *item['loc']))}: {'.'.join([*names, *map(str, item['loc'])])}: {error_text(item)}"
