"""Convert between ROS messages and YAML, as ``ros2`` uses it in arguments and output."""

import array
import re
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any, Final

import numpy as np
import yaml
from builtin_interfaces.msg import Time

from servoloop_ros2.ros2_error import Ros2Error

NOW: Final = ("now", "auto")
"""Values of a time or a header that mean the time at which the message is sent."""
ELEMENT: Final = re.compile(r"(?:sequence<)?([\w/]+)(?:<\d+>)?(?:\[\d+\]|, \d+>|>)?")
"""Pattern of a field's type. The pattern's group is the element type of a list, or the type itself."""
CONVERSIONS: Final[Mapping[str, Callable[[Any], Any]]] = {
    "float": float,
    "double": float,
    "string": str,
    "octet": lambda value: bytes([value]) if isinstance(value, int) else value.encode(),
}
"""Conversions of plain values, keyed by type."""


def find_type(name: str, kind: str) -> Any:
    """Return the class of a type such as ``std_msgs/msg/String``.

    Args:
        name: Name of the type. The middle part may be missing.
        kind: ``msg``, ``srv`` or ``action``.

    Raises:
        Ros2Error: The type does not exist.
    """
    parts = name.split("/")
    if len(parts) not in (2, 3) or (len(parts) == 3 and parts[1] != kind):
        raise Ros2Error(f"{name} is not a type: write PACKAGE/{kind}/NAME")
    try:
        return getattr(import_module(f"{parts[0]}.{kind}"), parts[-1])
    except (ImportError, AttributeError):
        raise Ros2Error(f"there is no type {parts[0]}/{kind}/{parts[-1]}: check its package and its name") from None


def read_values(text: str) -> Mapping[str, Any]:
    """Read the fields of a message from YAML. Raises Ros2Error."""
    try:
        values = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise Ros2Error(f"the values are not YAML: {' '.join(str(error).split())}") from None
    if values is None:
        return {}
    if not isinstance(values, Mapping):
        raise Ros2Error(f"the values must be fields of the message, such as '{{data: 1}}', not {text!r}")
    return values


def fill(message: Any, values: Mapping[str, Any], now: Time) -> None:
    """Set fields of a message. ``now`` is the time for the values ``now`` and ``auto``. Raises Ros2Error."""
    types = message.get_fields_and_field_types()
    for name, value in values.items():
        if name not in types:
            raise Ros2Error(f"{type(message).__name__} has no field {name}; its fields: {', '.join(types)}")
        try:
            setattr(message, name, _converted(getattr(message, name), types[name], value, now))
        except (AssertionError, TypeError, ValueError):
            raise Ros2Error(f"{type(message).__name__}.{name} is of type {types[name]}, not {value!r}") from None


def _converted(present: Any, kind: str, value: Any, now: Time) -> Any:
    """Convert a YAML value to a field's type. ``present`` is the field's current value."""
    if _is_message(present):
        return _nested(present, value, now)
    element = ELEMENT.fullmatch(kind)
    name = element[1] if element else kind
    if "/" in name:
        package, kind_name = name.split("/")
        return [_nested(getattr(import_module(f"{package}.msg"), kind_name)(), one, now) for one in value]
    convert: Callable[[Any], Any] = CONVERSIONS.get(name, lambda one: one)
    return convert(value) if name == kind else [convert(one) for one in value]


def _nested(message: Any, value: Any, now: Time) -> Any:
    if isinstance(message, Time) and value in NOW:
        return now
    if "stamp" in message.get_fields_and_field_types() and value == "auto":
        message.stamp = now
        return message
    if not isinstance(value, Mapping):
        raise Ros2Error(f"{type(message).__name__} has the fields {', '.join(message.get_fields_and_field_types())}")
    fill(message, value, now)
    return message


def as_yaml(message: Any) -> str:
    """Return the fields of a message as YAML."""
    return yaml.safe_dump(_plain(message), sort_keys=False, allow_unicode=True)


def _plain(value: Any) -> Any:
    if _is_message(value):
        return {name: _plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, bytes):
        return list(value) if len(value) != 1 else value[0]
    if isinstance(value, np.ndarray | array.array):
        return value.tolist()
    return [_plain(one) for one in value] if isinstance(value, list | tuple) else value


def _is_message(value: Any) -> bool:
    return hasattr(value, "get_fields_and_field_types")
