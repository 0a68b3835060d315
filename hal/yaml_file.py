"""Read YAML files as pydantic models. All errors in a file are reported together, each with its file and line."""

import re
from collections.abc import Sequence, Sized
from functools import partial
from pathlib import Path
from typing import Final, Protocol, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from drivers.printable import printable_line
from hal.yaml_nodes import YamlFile, listed, read

Model = TypeVar("Model", bound=BaseModel)

_TEXTS: Final = {
    "missing": "is missing: add the key",
    "extra_forbidden": "is not a known key: correct or remove it",
    "int_parsing_size": "has too many digits: use a smaller number",
    "string_pattern_mismatch": "must match the pattern '{pattern}'{not_value}",
    "union_tag_not_found": "has no {key}: add the key {key}",
    "union_tag_invalid": "has the unknown {key} '{tag}': use one of {expected_tags}",
    "too_short": "must have at least {min_length} {entries}, not {length}",
    "too_long": "must have at most {max_length} {entries}, not {length}",
    "string_too_short": "must have at least {min_length} {characters}, not {length}",
    "string_too_long": "must have at most {max_length} {characters}, not {length}",
}
"""Messages, keyed by the type of pydantic error. The names are those of ``_parts``."""
_SHOULD_BE: Final = "Input should be "
_CAUSE: Final = re.compile(
    r", (unable to parse|unable to interpret|got a number) .*$| or instance of \w+$| or object to extract fields from$"
)
"""Parts of pydantic's messages that ``error_text`` omits."""
_WORDS: Final = {
    "greater than or equal to": "at least",
    "less than or equal to": "at most",
    "greater than": "above",
    "less than": "below",
    "a valid dictionary": "a mapping",
    "a valid integer": "a whole number",
    "a valid number": "a number",
    "a valid string": "a text",
    "a valid list": "a list",
    "a valid tuple": "a list",
    "a valid set": "a list",
    "a valid frozenset": "a list",
    "a valid boolean": "true or false",
}
"""Terms in pydantic's messages, and their replacements."""
_SHOWN: Final = 50
"""Maximum number of characters of a value in a message."""


class YamlPlaces(Protocol):
    """Lookup of a value's file and line."""

    def place(self, location: Sequence[int | str]) -> str:
        """Return the file and line of the innermost part of ``location`` that exists in the file."""


def load(path: Path, model: type[Model], error: type[Exception]) -> Model:
    """Read a file as a model. Raises ``error`` with a message that lists every error and its line."""
    return load_with_lines(path, model, error)[0]


def load_with_lines(path: Path, model: type[Model], error: type[Exception]) -> tuple[Model, YamlFile]:
    """Read a file as a model and as nodes with line numbers. Raises ``error`` in the same cases as ``load``."""
    file, content = read(path, error)
    try:
        return model.model_validate(content), file
    except ValidationError as reason:
        raise error("\n".join(mistakes(file, reason))) from reason


def mistakes(file: YamlPlaces, error: ValidationError, within: Sequence[int | str] = (), name: str = "") -> list[str]:
    """List the errors in a model, each with its file and line.

    Args:
        file: The file, used to look up line numbers.
        error: The error that pydantic raised.
        within: Location of the model in the file.
        name: Name that precedes the keys in each message.
    """
    return listed([partial(_mistake, file, item, within, name) for item in error.errors(include_url=False)])


def error_text(item: ErrorDetails) -> str:
    """Return a plain message for a pydantic error, worded to follow the name of a key.

    Args:
        item: The error.

    Returns:
        The message, such as "must be at most 253, not 254".
    """
    value = item["input"]
    if item["type"] == "string_type" and isinstance(value, bool):
        return f"{str(value).lower()} is read as a boolean: put the text in quotes"
    if item["type"] == "string_type" and isinstance(value, int | float):
        return f"{value} is read as a number: put the text in quotes ('{value}')"
    if text := _TEXTS.get(item["type"]):
        return text.format_map(_parts(item))
    message = item["msg"].removeprefix("Value error, ")
    if not message.startswith(_SHOULD_BE):
        return message
    wanted = _CAUSE.sub("", message.removeprefix(_SHOULD_BE))
    for theirs, ours in _WORDS.items():
        wanted = wanted.replace(theirs, ours)
    return f"must be {wanted}{_not(value)}"


def named_text(item: ErrorDetails) -> str:
    """Return the message of ``error_text`` after the name of its key. An error of the whole model has no name."""
    return ": ".join(filter(None, (".".join(map(str, item["loc"])), error_text(item))))


def _parts(item: ErrorDetails) -> dict[str, object]:
    """Return the values for the messages in ``_TEXTS``, which include those of pydantic."""
    value, context = item["input"], item.get("ctx", {})
    most = context.get("min_length", context.get("max_length"))
    return {
        **context,
        "not_value": _not(value),
        "key": str(context.get("discriminator", "")).strip("'"),
        "entries": "entry" if most == 1 else "entries",
        "characters": "character" if most == 1 else "characters",
        "length": len(value) if isinstance(value, Sized) else context.get("actual_length"),
    }


def _not(value: object) -> str:
    if isinstance(value, bool):
        return f", not {str(value).lower()}"
    if isinstance(value, int | float):
        return f", not {value}"
    return f", not {printable_line(value[:_SHOWN])!r}" if isinstance(value, str) else ""


def _mistake(file: YamlPlaces, item: ErrorDetails, within: Sequence[int | str], name: str) -> str:
    names = [*([name] if name else []), *map(str, item["loc"])]
    return ": ".join(filter(None, (file.place((*within, *item["loc"])), ".".join(names), error_text(item))))
