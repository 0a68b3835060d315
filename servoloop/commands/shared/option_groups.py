"""Define related options once, as the fields of a dataclass that several commands accept as a parameter."""

from collections.abc import Callable, Iterator
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import wraps
from inspect import Parameter, Signature, signature
from typing import Any, get_type_hints


def grouped_options(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command whose dataclass parameters are replaced by one parameter for each of their fields.

    Typer reads the fields as options or arguments, in place of the dataclass. Fields have annotations and defaults
    like other parameters of a command.

    Args:
        command: Function with at least one parameter whose type is a dataclass.

    Returns:
        The command to register with typer.

    Raises:
        TypeError: Two parameters have the same name.
    """
    hints = get_type_hints(command, include_extras=True)
    groups = {name: kind for name, kind in hints.items() if isinstance(kind, type) and is_dataclass(kind)}

    @wraps(command)
    def ungrouped(**values: Any) -> None:
        built = {
            name: kind(**{one.name: values.pop(one.name) for one in fields(kind)}) for name, kind in groups.items()
        }
        command(**values, **built)

    seen: dict[str, Parameter] = {}
    for parameter in _parameters(command, groups):
        if parameter.name in seen:
            raise TypeError(f"{command.__name__}: two parameters have the name {parameter.name!r}; rename one of them")
        seen[parameter.name] = parameter
    ungrouped.__annotations__ = {name: one.annotation for name, one in seen.items()}
    ungrouped.__signature__ = Signature(list(seen.values()))  # type: ignore[attr-defined]
    return ungrouped


def _parameters(command: Callable[..., None], groups: dict[str, Any]) -> Iterator[Parameter]:
    """Yield a command's parameters. Each dataclass parameter is replaced by one parameter per field."""
    for parameter in signature(command).parameters.values():
        if parameter.name in groups:
            yield from _fields_of(groups[parameter.name])
        else:
            # A field without a default may follow a parameter that has one.
            yield parameter.replace(kind=Parameter.KEYWORD_ONLY)


def _fields_of(group: Any) -> Iterator[Parameter]:
    """Yield a parameter for each field of a dataclass."""
    hints = get_type_hints(group, include_extras=True)
    for field in fields(group):
        yield Parameter(field.name, Parameter.KEYWORD_ONLY, default=_default_of(field), annotation=hints[field.name])


def _default_of(field: Field[Any]) -> Any:
    return Parameter.empty if field.default is MISSING else field.default
