"""Base class of all nodes of the stack."""

from collections.abc import Callable
from typing import Any, Final

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.clock import Clock
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.time_source import USE_SIM_TIME_NAME, TimeSource
from rclpy.timer import Timer

from nodes.rclpy_patches import type_service
from nodes.rclpy_patches.guard import usable_patches
from nodes.ros_time import RosTime
from nodes.set_parameters import answering

NO_EVENT_CALLBACKS: Final = PublisherEventCallbacks(use_default_callbacks=False)
"""Event callbacks without warnings about incompatible subscribers. The omitted callbacks would add one more event to
each wait."""


class ParameterNode(Node):
    """A node whose parameters behave like those of rclcpp and whose clock follows the control loop.

    The parameter ``use_sim_time`` reports whether the loop's time is simulated. Setting ``use_sim_time`` has no effect,
    because stamps from another clock would not match those of the loop.
    """

    def __init__(self, name: str, ros_time: RosTime, allow_undeclared_parameters: bool = False, **more: Any) -> None:
        self._ros_time = ros_time
        self._undeclared_allowed = allow_undeclared_parameters
        self.parameter_callbacks: list[tuple[Callable[[Any], None], Any]] = []
        """Parameter callbacks of the node, stored as pairs of the method that removes the callback and the callback
        itself."""
        super().__init__(name, allow_undeclared_parameters=allow_undeclared_parameters, **more)
        if ros_time.simulated:
            self.set_parameters([Parameter(USE_SIM_TIME_NAME, value=True)])

    def get_clock(self) -> Clock:
        """Return the clock of the stack. The node's own rclpy clock would follow ``use_sim_time``."""
        return self._ros_time.clock

    def create_timer(
        self, timer_period_sec: float, callback: Any, callback_group: Any = None, clock: Any = None, **more: Any
    ) -> Timer:
        return super().create_timer(timer_period_sec, callback, callback_group, clock or self._ros_time.clock, **more)

    @property
    def parameter_names(self) -> frozenset[str]:
        """Names of all parameters that have a value or have been declared."""
        return frozenset(self.get_parameters_by_prefix(""))

    def forget_parameter(self, name: str) -> None:
        """Undeclare a parameter, even if it is read-only."""
        self.describe_parameter(name).read_only = False
        self.undeclare_parameter(name)

    def add_pre_set_parameters_callback(self, callback: Any) -> None:
        super().add_pre_set_parameters_callback(callback)
        self.parameter_callbacks.append((self.remove_pre_set_parameters_callback, callback))

    def add_on_set_parameters_callback(self, callback: Any) -> None:
        if self._ros_time.simulated and isinstance(getattr(callback, "__self__", None), TimeSource):
            return  # The parameter would subscribe every node to the /clock topic of this process.
        super().add_on_set_parameters_callback(callback)
        self.parameter_callbacks.append((self.remove_on_set_parameters_callback, callback))

    def add_post_set_parameters_callback(self, callback: Any) -> None:
        super().add_post_set_parameters_callback(callback)
        self.parameter_callbacks.append((self.remove_post_set_parameters_callback, callback))

    def create_publisher(self, msg_type: Any, topic: str, qos_profile: Any, **more: Any) -> Any:
        if topic == "/parameter_events":
            more["event_callbacks"] = NO_EVENT_CALLBACKS
        return super().create_publisher(msg_type, topic, qos_profile, **more)

    def create_service(self, srv_type: Any, srv_name: str, callback: Any, **more: Any) -> Any:
        return super().create_service(srv_type, srv_name, answering(srv_type, callback), **more)

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        for parameter in parameter_list:
            if refusal := self._refusal(parameter.name):
                reason = f"parameter '{parameter.name}' cannot be set because it {refusal}"
                return SetParametersResult(successful=False, reason=reason)
            if parameter.name == USE_SIM_TIME_NAME and parameter.value is not self._ros_time.simulated:
                source = "simulated time" if self._ros_time.simulated else "the system clock"
                self.get_logger().warning(f"use_sim_time has no effect: the loop and its stamps still use {source}")
        new = [parameter.name for parameter in parameter_list if not self.has_parameter(parameter.name)]
        result: SetParametersResult = super().set_parameters_atomically(parameter_list)
        for name in new if result.successful else ():
            if self.has_parameter(name):  # The type was not declared, so the next value may have a different type.
                self.set_descriptor(name, ParameterDescriptor(dynamic_typing=True))
        return result

    def describe_parameter(self, name: str) -> ParameterDescriptor:
        """Return the descriptor of a parameter, including its name and type even if the parameter was never declared
        (unlike rclpy)."""
        known = super().describe_parameter(name)
        return known if known.name else ParameterDescriptor(name=name, type=self.get_parameter_type(name))

    def get_parameter_type(self, name: str) -> int:
        """Return the type of the parameter as a number. For an unknown parameter, rclpy returns an enum, which the
        service rejects."""
        kind: int | Parameter.Type = super().get_parameter_type(name)
        return kind.value if isinstance(kind, Parameter.Type) else kind

    def destroy_node(self) -> None:
        if type_service.PATCH in usable_patches():
            type_service.remove_type_service(self)
        super().destroy_node()

    def _refusal(self, name: str) -> str:
        if not self.has_parameter(name):
            return "" if self._undeclared_allowed else "was not declared"
        return "is read-only" if self.describe_parameter(name).read_only else ""
