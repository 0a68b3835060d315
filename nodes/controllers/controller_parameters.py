"""A controller's parameters as those of its ROS node."""

from collections.abc import Callable, Iterator, Mapping
from enum import Enum
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from controller.parameters import Parameters
from hal.yaml_file import error_text

BOUNDS = {"ge": "at least", "gt": "more than", "le": "at most", "lt": "less than"}


class ControllerParameters:
    """Declares all of ``parameters`` on ``node``, nested ones with dots (``constraints.joint1.goal``).

    Read-only but for those that ``settable`` names, or whose group it names, and those that are missing: they can be
    set until the controller is ``configured``. ``change`` is told the new parameters and raises ValueError where it
    refuses them.
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
        """Declare the parameters that the node has not yet: a joint's constraints come with the joint."""
        for name, value, info in flat(parameters):
            if not self._node.has_parameter(name):
                _declare(self._node, name, value, _descriptor(value, info, _may_be_set(name, self._settable)))
                self._names.add(name)

    def _on_set(self, parameters: list[Parameter]) -> SetParametersResult:
        own = {parameter.name: parameter.value for parameter in parameters if parameter.name in self._names}
        if not own:
            return SetParametersResult(successful=True)
        if (late := self._late & own.keys()) and self._configured():
            reason = f"{', '.join(sorted(late))} can be set only before it is configured: clean the controller up first"
            return SetParametersResult(successful=False, reason=reason)
        try:
            changed = changed_by(self._parameters, own)
            self._change(changed)
        except ValueError as error:
            return SetParametersResult(successful=False, reason=_said(error))
        self._parameters = changed
        self._declare(changed)
        return SetParametersResult(successful=True)


def flat(model: BaseModel, prefix: str = "") -> Iterator[tuple[str, Any, FieldInfo | None]]:
    """Yields each value with its dotted name and its model's field; None for a value that is missing."""
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
    """The parameters with other values, by dotted names. Raises pydantic's ValidationError."""
    content = parameters.model_dump(warnings=False)  # where some are missing, the others are as they were given
    for name, value in values.items():
        *groups, last = name.split(".")
        inner = content
        for group in groups:
            inner = inner.setdefault(group, {})
        inner[last] = value
    return type(parameters).as_far_as_given(content)


def _plain(value: Any) -> Any:
    """A value as a ROS parameter: enumerations by value, sequences as lists."""
    if isinstance(value, Enum):
        return value.value
    return [_plain(one) for one in value] if isinstance(value, tuple | list | set | frozenset) else value


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
    if value == []:  # whose type rclpy would guess to be bytes
        kind = Parameter.Type.STRING_ARRAY
        node.declare_parameter(name, kind)
        node.set_parameters([Parameter(name, kind, [])])
        descriptor.type = kind.value
        node.set_descriptor(name, descriptor)
    else:
        # an override (-p) is in the value already, and has its type
        node.declare_parameter(name, value, descriptor, ignore_override=True)


def _said(error: ValueError) -> str:
    if isinstance(error, ValidationError):
        return "; ".join(f"{'.'.join(map(str, item['loc']))}: {error_text(item)}" for item in error.errors())
    return str(error)
