"""Read the manager's settings for a controller from the controllers file, a service call or the spawner."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Self

from drivers.printable import printable

SETTINGS: Final = ("type", "fallback_controllers", "params_file", "node_options_args")
"""Names of the settings, which are not parameters of the controller itself."""


@dataclass(frozen=True, slots=True)
class ManagerSettings:
    """The manager's settings for one controller. An empty setting is treated as not set."""

    kind: str = ""
    files: tuple[Path, ...] = ()
    """Parameter files. Later files take priority."""
    fallback: tuple[str, ...] = ()
    """Controllers that take over if this controller fails."""
    node_arguments: tuple[str, ...] = ()
    """ROS arguments of the controller's node."""

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """Read settings from values for which ``setting_mistakes`` reports no errors. Values with other names are
        ignored."""
        arguments = values.get("node_options_args")
        return cls(
            values.get("type") or "",
            tuple(Path(path) for path in _texts(values.get("params_file"))),
            _texts(values.get("fallback_controllers")),
            # A single string is split in the same way as the spawner splits --controller-ros-args.
            tuple(arguments.split()) if isinstance(arguments, str) else _texts(arguments),
        )

    def over(self, other: "ManagerSettings") -> "ManagerSettings":
        """Return these settings, taking missing values from ``other``."""
        return ManagerSettings(
            self.kind or other.kind,
            self.files or other.files,
            self.fallback or other.fallback,
            self.node_arguments or other.node_arguments,
        )


def setting_mistakes(values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the name of each setting that has an invalid value, and a description of the error."""
    for name in SETTINGS:
        if name in values and (mistake := setting_mistake(name, values[name])):
            yield name, mistake


def setting_mistake(name: str, value: Any) -> str:
    """Describe the error in the value of a setting. The description is empty if the value is valid."""
    shown = printable(repr(value))
    if name == "type":
        return (
            "" if isinstance(value, str) else f"is {shown}, which is not a controller type: write the type as a string"
        )
    parts = [value] if isinstance(value, str) else value
    right = isinstance(parts, list | tuple) and all(isinstance(part, str) for part in parts)
    return "" if right else f"is {shown}: use a string or a list of quoted strings"


def _texts(value: Any) -> tuple[str, ...]:
    return (value,) * bool(value) if isinstance(value, str) else tuple(value or ())
