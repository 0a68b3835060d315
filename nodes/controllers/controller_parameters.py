"""Expose the parameters of a controller as parameters of its ROS node."""

from collections.abc import Callable, Iterator, Mapping
from enum import Enum
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from controller.parameters import Parameters
from hal.yaml_file import named_text

BOUNDS = {"ge": "at least", "gt": "more than", "le": "at most", "lt": "less than"}


class ControllerParameters:
    """ROS parameters of one controller. Names of nested parameters contain dots (``constraints.joint1.goal``).

    A parameter can be set if its own name or its group's name is in ``settable``. A parameter without a value can be
    set until the controller has been ``configured``. All other parameters are read-only. The ``change`` function
    receives the new parameters and raises ValueError to reject them.
    """

    def __init__(
        self,
        node: Node,
        parameters: Parameters,
        settable: frozenset[str],
        change: Callable[[Parameters], None],
        configured: Callable[[], bool],
    ) -> None:
        self._node = node
        self._parameters = parameters
        self._late = frozenset(parameters.missing())
        self._settable = settable | self._late
        self._change = change
        self._configured = configured
        self._names = set[str]()
        self._declare(parameters)
        node.add_on_set_parameters_callback(self._on_set)

    def _declare(self, parameters: Parameters) -> None:
        """Declare new parameters, such as the constraints for an added joint."""
        for name, value, info in flat(parameters):
            if not self._node.has_parameter(name):
                _declare(self._node, name, value, _descriptor(value, info, _may_be_set(name, self._settable)))
                self._names.add(name)

    def _on_set(self, parameters: list[Parameter]) -> SetParametersResult:
        own = {parameter.name: parameter.value for parameter in parameters if parameter.name in self._names}
        if not own:
            return SetParametersResult(successful=True)
        if (late := self._late & own.keys()) and self._configured():
            reason = (
                f"{', '.join(sorted(late))} can be set only before the controller is configured: "
                "clean up the controller"
            )
            return SetParametersResult(successful=False, reason=reason)
        try:
            changed = changed_by(self._parameters, own)
            self._change(changed)
        except ValueError as error:
            return SetParametersResult(successful=False, reason=_describe(error))
        self._parameters = changed
        self._declare(changed)
        return SetParametersResult(successful=True)


def flat(model: BaseModel, prefix: str = "") -> Iterator[tuple[str, Any, FieldInfo | None]]:
    """Yield the dotted name, value and model field of each parameter. A missing parameter has the value None."""
    infos = type(model).model_fields
    for name in (*infos, *(model.model_extra or {})):
        yield from _flat_value(f"{prefix}{name}", getattr(model, name, None), infos.get(name))


def _flat_value(name: str, value: Any, info: FieldInfo | None) -> Iterator[tuple[str, Any, FieldInfo | None]]:
    if isinstance(value, BaseModel):
        yield from flat(value, f"{name}.")
    elif isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _flat_value(f"{name}.{key}", inner, None)
    else:
        yield name, _plain(value), info


def changed_by(parameters: Parameters, values: Mapping[str, Any]) -> Parameters:
    """Return a copy of the parameters with some values changed.

    Args:
        parameters: Current parameters.
        values: New values, keyed by dotted name.

    Raises:
        ValidationError: A value is invalid.
    """
    # If some parameters are missing, the other parameters have not been validated and may cause warnings.
    content = parameters.model_dump(warnings=False)
    for name, value in values.items():
        *groups, last = name.split(".")
        inner = content
        for group in groups:
            inner = inner.setdefault(group, {})
        inner[last] = value
    return type(parameters).as_far_as_given(content)


def _plain(value: Any) -> Any:
    """Convert enumerations to their values, and sequences to lists, as required for ROS parameters."""
    if isinstance(value, Enum):
        return value.value
    return [_plain(item) for item in value] if isinstance(value, tuple | list | set | frozenset) else value


def _may_be_set(name: str, settable: frozenset[str]) -> bool:
    parts = name.split(".")
    return any(".".join(parts[:length]) in settable for length in range(1, len(parts) + 1))


def _descriptor(value: Any, info: FieldInfo | None, settable: bool) -> ParameterDescriptor:
    bounds = [
        f"{words} {getattr(item, key):g}"
        for item in (info.metadata if info else ())
        for key, words in BOUNDS.items()
        if getattr(item, key, None) is not None
    ]
    return ParameterDescriptor(
        description=(info.description if info else None) or "",
        additional_constraints=", ".join(bounds),
        read_only=not settable,
        dynamic_typing=value is None,
    )


def _declare(node: Node, name: str, value: Any, descriptor: ParameterDescriptor) -> None:
    if value == []:  # rclpy would interpret an empty list as a list of bytes.
        kind = Parameter.Type.STRING_ARRAY
        node.declare_parameter(name, kind)
        node.set_parameters([Parameter(name, kind, [])])
        descriptor.type = kind.value
        node.set_descriptor(name, descriptor)
    else:
        # The value already contains an override (-p) of the right type.
        node.declare_parameter(name, value, descriptor, ignore_override=True)


def _describe(error: ValueError) -> str:
    if isinstance(error, ValidationError):
        return "; ".join(map(named_text, error.errors()))
    return str(error)
