"""Faults as command-line strings, such as ``silent id=3 for=2s``: the type of the fault, followed by its parameters in
any order."""

import shlex
from collections.abc import Callable
from difflib import get_close_matches
from typing import Any, Final

from pydantic import ValidationError

from hal.yaml_file import error_text
from sim_backend.faults.event import Event
from sim_backend.faults.events import EVENT, KINDS
from sim_backend.faults.fault_error import FaultError

_WORDS: Final = {"servo_id": "id", "other_id": "other", "back_as": "as", "register_name": "register"}
_UNITS: Final = ("_s", "_v", "_ohm", "_nm", "_rad", "_c")
_TIMES: Final = ("at_s", "since", "for_s")
"""Parameters that all fault types have. These parameters come last in the usage text."""


def words(kind: type[Event]) -> dict[str, str]:
    """Return the parameters of a fault type, as a mapping from the word used on the command line to the field."""
    fields = [name for name in kind.model_fields if name != "kind" and not _never(kind, name)]
    fields.sort(key=lambda name: (name in _TIMES, not kind.model_fields[name].is_required()))
    return {word_of(name): name for name in fields}


def word_of(field: str) -> str:
    """Return the command-line word for a field, which is usually the field's name without the unit."""
    return _WORDS.get(field) or next((field.removesuffix(u) for u in _UNITS if field.endswith(u)), field)


def _never(kind: type[Event], field: str) -> bool:
    """Return whether this fault type never uses the field. A momentary fault, for example, has no duration."""
    return kind.model_fields[field].annotation in (None, type(None))


def usage(kind: type[Event]) -> str:
    """Return the usage text of a fault type, with optional parameters in brackets."""
    parts = [kind.model_fields["kind"].default]
    for word, field in words(kind).items():
        text = f"{word}={'SECONDS' if field.endswith('_s') else word.upper()}"
        parts.append(text if kind.model_fields[field].is_required() else f"[{text}]")
    return " ".join(parts)


def parse(text: str) -> Any:
    """Parse one fault. Raises FaultError with a list of all errors."""
    kind, name, parameters = _split(text)
    return _event(kind, name, text, parameters)


def matching(text: str) -> Callable[[Event], bool]:
    """Return a function that checks whether an event has the type and parameters specified in ``text``.

    An empty string matches every event. Raises FaultError.
    """
    if not text.strip():
        return lambda event: True
    kind, name, parameters = _split(text)
    known, wanted = words(kind), dict[str, Any]()
    for parameter in parameters:
        word, equals, value = parameter.partition("=")
        if not equals or word not in known:
            raise FaultError(f"{parameter}: {name} has only the parameters {', '.join(f'{each}=' for each in known)}")
        wanted[known[word]] = _seconds(value) if known[word].endswith("_s") else value
    return lambda event: (
        event.kind == name and all(_equal(getattr(event, field), value) for field, value in wanted.items())
    )


def _equal(held: Any, wanted: Any) -> bool:
    try:
        return float(held) == float(wanted)
    except (TypeError, ValueError):
        return str(held) == str(wanted)


def _split(text: str) -> tuple[type[Event], str, list[str]]:
    """Return the class of the fault type, its name and the parameters. Raises FaultError."""
    try:
        name, *parameters = shlex.split(text) or [""]
    except ValueError as error:
        raise FaultError(f"{text!r} is not valid: {str(error).lower()}") from None
    kind = KINDS.get(name)
    if kind is None:
        near = get_close_matches(name, KINDS)
        meant = f"did you mean {' or '.join(near)}?" if near else f"known faults: {', '.join(KINDS)}"
        raise FaultError(f"there is no fault {name!r}: {meant}")
    return kind, name, parameters


def _event(kind: type[Event], name: str, text: str, parameters: list[str]) -> Any:
    known, values, wrong = words(kind), dict[str, Any](), list[str]()
    for parameter in parameters:
        word, equals, value = parameter.partition("=")
        if not equals or word not in known:
            wrong.append(f"{parameter}: {name} has only the parameters {', '.join(f'{each}=' for each in known)}")
        elif known[word] in values:
            wrong.append(f"{parameter}: {word} is given twice")
        else:
            values[known[word]] = _seconds(value) if known[word].endswith("_s") else value
    try:
        event = EVENT.validate_python({"kind": name, **values})
    except ValidationError as error:
        for item in error.errors():
            field = str(item["loc"][1]) if len(item["loc"]) > 1 else ""
            wrong.append(f"{word_of(field)}: {error_text(item)}" if field else error_text(item))
    if wrong:
        raise FaultError(f"{text!r}: {'; '.join(wrong)}. Usage: {usage(kind)}")
    return event


def _seconds(value: str) -> Any:
    """Convert a time with or without a unit to seconds. Other values are returned unchanged for later checks."""
    for unit, scale in (("ms", 1e-3), ("s", 1.0)):
        if value.endswith(unit):
            try:
                return float(value.removesuffix(unit)) * scale
            except ValueError:
                return value
    return value


def text_of(event: Event) -> str:
    """Return the string from which ``parse`` creates this event."""
    parts = [event.kind]
    for word, field in words(type(event)).items():
        value = getattr(event, field)
        if value == type(event).model_fields[field].default:
            continue
        parts.append(f"{word}={shlex.quote(str(value))}{'s' if field.endswith('_s') else ''}")
    return " ".join(parts)
