"""Import the module of a command only when the command is used, so that every command starts quickly."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Final

import typer
from typer.core import TyperGroup
from typer.main import get_group

PACKAGE: Final = "servoloop.commands"
MARKUP: Final = "markdown"


@dataclass(frozen=True, slots=True)
class Place:
    """Location of a command's function or of a group's ``typer.Typer``, such as ``up:demo``, in PACKAGE."""

    path: str
    panel: str | None = None
    """Panel of ``servoloop --help``, or None for the panel without a title."""
    negative_numbers: bool = False
    """Whether arguments may be negative numbers, although these look like options."""


class LazyCommands(Mapping[str, Any]):
    """Typer commands, keyed by name. A command is imported when it is looked up."""

    def __init__(self, places: Mapping[str, Place]) -> None:
        self._places = places
        self._loaded: dict[str, Any] = {}

    def __getitem__(self, name: str) -> Any:
        if name not in self._loaded:
            self._loaded[name] = _load(name, self._places[name])
        return self._loaded[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)


def lazy_group(places: Mapping[str, Place]) -> type[TyperGroup]:
    """Return a class of command groups that contains the commands in ``places``."""

    class LazyGroup(TyperGroup):
        def __init__(self, **attributes: Any) -> None:
            super().__init__(**attributes)
            self.commands = LazyCommands(places)  # type: ignore[assignment]  # Typer only reads them.

    return LazyGroup


def _load(name: str, place: Place) -> Any:
    module, _, attribute = place.path.partition(":")
    loaded = getattr(import_module(f"{PACKAGE}.{module}"), attribute)
    parent = typer.Typer(callback=lambda: None, rich_markup_mode=MARKUP)  # With a callback, typer creates a group.
    if isinstance(loaded, typer.Typer):
        parent.add_typer(loaded, name=name, rich_help_panel=place.panel)
    else:
        settings = {"ignore_unknown_options": place.negative_numbers}
        parent.command(name, rich_help_panel=place.panel, context_settings=settings)(loaded)
    return get_group(parent).commands[name]
