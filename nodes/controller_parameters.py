"""A controller's parameters as those of its ROS node."""

from collections.abc import Callable, Iterator, Mapping
from enum import Enum
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.clock import ROSClock
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.time_source import USE_SIM_TIME_NAME

from controller.parameters import Parameters
from nodes.type_service import take_off_type_service

BOUNDS = {"ge": "at least", "gt": "more than", "le": "at most", "lt": "less than"}


QUIET = PublisherEventCallbacks(use_default_callbacks=False)
"""Without warnings of listeners that do not fit. Each such warning is one more thing to wait on in every cycle."""


class ParameterNode(Node):
    """A node of the stack: its parameters answer like rclcpp's, its time is the machine's.

    ``use_sim_time`` has no effect: the loop keeps the machine's clock, and another one's stamps would not fit it.
    """

    def __init__(self, name: str, **more: Any) -> None:
        super().__init__(name, **more)
        self._clock = ROSClock()  # the first one follows use_sim_time, and with it timers and stamps would

    @property
    def parameter_names(self) -> frozenset[str]:
        """Of all that have a value or were declared."""
        return frozenset(self._parameters)

    def forget_parameter(self, name: str) -> None:
        """Also a read-only one."""
        del self._parameters[name], self._descriptors[name]

    def create_publisher(self, msg_type: Any, topic: str, qos_profile: Any, **more: Any) -> Any:
        if topic == "/parameter_events":
            more["event_callbacks"] = QUIET
        return super().create_publisher(msg_type, topic, qos_profile, **more)

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        for parameter in parameter_list:
            if why := self._why_not(parameter.name):
                reason = f"parameter '{parameter.name}' cannot be set because it {why}"
                return SetParametersResult(successful=False, reason=reason)
            if parameter.name == USE_SIM_TIME_NAME and parameter.value:
                self.get_logger().warning(
                    "use_sim_time has no effect: the loop and its stamps keep the machine's clock"
                )
        return super().set_parameters_atomically(parameter_list)

    def describe_parameter(self, name: str) -> ParameterDescriptor:
        """Also of what was set without having been declared, which rclpy leaves without name and type."""
        known = super().describe_parameter(name)
        return known if known.name else ParameterDescriptor(name=name, type=self.get_parameter_type(name))

    def get_parameter_type(self, name: str) -> int:
        """A number, as it goes into an answer: of what is not there, rclpy's own would end the service's callback."""
        kind: int | Parameter.Type = super().get_parameter_type(name)
        return kind.value if isinstance(kind, Parameter.Type) else kind

    def destroy_node(self) -> None:
        take_off_type_service(self)
        super().destroy_node()

    def _why_not(self, name: str) -> str:
        if not self.has_parameter(name):
            return "" if self._allow_undeclared_parameters else "was not declared"
        return "is read-only" if self.describe_parameter(name).read_only else ""


class ControllerParameters:
    """Declares all of ``parameters`` on ``node``, nested ones with dots (``constraints.joint1.goal``).

    Read-only but for those that ``settable`` names, or whose group it names. ``change`` is told the new parameters
    and raises ValueError where it refuses them.
    """

    def __init__(
        self, node: Node, parameters: Parameters, settable: frozenset[str], change: Callable[[Parameters], None]
    ) -> None:
        self._parameters = parameters
        self._change = change
        self._names = set[str]()
        for name, value, info in flat(parameters):
            if node.has_parameter(name):
                continue  # one that every node has, such as use_sim_time
            _declare(node, name, value, _descriptor(value, info, _may_be_set(name, settable)))
            self._names.add(name)
        node.add_on_set_parameters_callback(self._on_set)

    def _on_set(self, parameters: list[Parameter]) -> SetParametersResult:
        own = {parameter.name: parameter.value for parameter in parameters if parameter.name in self._names}
        if not own:
            return SetParametersResult(successful=True)
        try:
            changed = changed_by(self._parameters, own)
            self._change(changed)
        except ValueError as error:
            return SetParametersResult(successful=False, reason=_said(error))
        self._parameters = changed
        return SetParametersResult(successful=True)


def flat(model: BaseModel, prefix: str = "") -> Iterator[tuple[str, Any, FieldInfo | None]]:
    """Every value with its dotted name, and what its model says of it."""
    infos = type(model).model_fields
    for name in (*infos, *(model.model_extra or {})):
        yield from _flat_value(f"{prefix}{name}", getattr(model, name), infos.get(name))


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
    content = parameters.model_dump()
    for name, value in values.items():
        *groups, last = name.split(".")
        inner = content
        for group in groups:
            inner = inner.setdefault(group, {})
        inner[last] = value
    return type(parameters).model_validate(content)


def _plain(value: Any) -> Any:
    """As ROS has it: enumerations by value, sequences as lists."""
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
        return "; ".join(f"{'.'.join(map(str, item['loc']))}: {item['msg']}" for item in error.errors())
    return str(error)
