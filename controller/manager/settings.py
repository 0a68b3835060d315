"""A controller's settings for the manager mean the same in the controllers file, in a service and from the spawner."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Self

from drivers.printable import printable

SETTINGS: Final = ("type", "fallback_controllers", "params_file", "node_options_args")
"""The names of the settings, which are not parameters of the controller itself."""


@dataclass(frozen=True, slots=True)
class Settings:
    """The settings of one controller; empty ones are not given."""

    kind: str = ""
    files: tuple[Path, ...] = ()
    """Parameter files, the last of which counts most."""
    fallback: tuple[str, ...] = ()
    """Controllers that take over when it fails."""
    node_arguments: tuple[str, ...] = ()
    """ROS arguments of its node."""

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """Read settings that have no ``setting_mistakes``, by their names; other names are passed over."""
        arguments = values.get("node_options_args")
        return cls(
            values.get("type") or "",
            tuple(Path(path) for path in _texts(values.get("params_file"))),
            _texts(values.get("fallback_controllers")),
            # A single text is split, as the spawner splits --controller-ros-args.
            tuple(arguments.split()) if isinstance(arguments, str) else _texts(arguments),
        )

    def over(self, other: "Settings") -> "Settings":
        """Return these settings, with those of ``other`` for the ones that are not given."""
        return Settings(
            self.kind or other.kind,
            self.files or other.files,
            self.fallback or other.fallback,
            self.node_arguments or other.node_arguments,
        )


def setting_mistakes(values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the name of each setting whose value makes no sense, and the mistake."""
    for name in SETTINGS:
        if name in values and (mistake := setting_mistake(name, values[name])):
            yield name, mistake


def setting_mistake(name: str, value: Any) -> str:
    """Describe what is wrong with the value of a setting; empty if it is right."""
    shown = printable(repr(value))
    if name == "type":
        return "" if isinstance(value, str) else f"is {shown}, which is not a type of controllers: write one as a text"
    parts = [value] if isinstance(value, str) else value
    right = isinstance(parts, list | tuple) and all(isinstance(part, str) for part in parts)
    return "" if right else f"is {shown}: write a text, or a list of texts in quotes"


def _texts(value: Any) -> tuple[str, ...]:
    """A setting of one or several texts."""
    return (value,) * bool(value) if isinstance(value, str) else tuple(value or ())
