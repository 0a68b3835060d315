"""Serve ``/controller_manager``, through which ``ros2 control`` and the spawner list and switch controllers."""

from collections.abc import Awaitable, Callable, Iterator, Mapping
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from builtin_interfaces.msg import Time
from controller_manager_msgs.msg import ControllerManagerActivity, ControllerState, NamedLifecycleState
from controller_manager_msgs.srv import (
    CleanupController,
    ConfigureController,
    ListControllers,
    ListControllerTypes,
    LoadController,
    ReloadControllerLibraries,
    SwitchController,
    UnloadController,
)
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.duration import Duration
from rclpy.parameter import Parameter
from std_msgs.msg import String

from controller.manager.client import ManagerClient
from controller.manager.requests import Request
from controller.manager.settings import SETTINGS, ManagerSettings, setting_mistake
from controller.manager.switch import Loaded, Strictness, SwitchRequest
from controller.parameters import ManagerParameters
from drivers.printable import printable
from hal.lifecycle import LifecycleState
from hal.plausible import RANGES, range_mistake
from hal.types import JointState
from nodes.lifecycle_messages import state_message
from nodes.manager.only_manager import MANAGER, OTHER
from nodes.manager.pending_requests import PendingRequests
from nodes.only_one import OtherNodes
from nodes.parameter_node import ParameterNode
from nodes.publishing import EVERY_CALL, LATCHED
from nodes.rclpy_patches.client_limits import CLIENT_LIMITS, PARAMETER
from nodes.ros_environment import INSTALL
from nodes.ros_time import RosTime
from nodes.stack import Stack

if TYPE_CHECKING:
    from nodes.manager.introspection import Introspection

BASE_CLASS = "controller_interface::ControllerInterface"


class ManagerNode:
    """Node ``/controller_manager``. The methods run in the ROS thread and wait for the control loop without blocking
    other requests."""

    def __init__(
        self, stack: Stack, manager_client: ManagerClient, pending: PendingRequests, ros_time: RosTime
    ) -> None:
        self.node = ParameterNode(MANAGER, ros_time, allow_undeclared_parameters=True)
        self._stack = stack
        self._manager_client = manager_client
        self._pending = pending
        self._published: object = None
        self.others = OtherNodes(self.node, OTHER)
        self._activity = self.node.create_publisher(ControllerManagerActivity, "~/activity", LATCHED)
        self.node.create_subscription(String, "robot_description", self._on_description, LATCHED)
        parameters = stack.factory.file.manager
        self._declare(parameters)
        self._introspection = self._introspect(stack) if parameters.get("publish_introspection") else None
        group = ReentrantCallbackGroup()  # Other requests are served while one request is waiting.
        for kind, name, callback in (
            (ListControllers, "list_controllers", self._controllers),
            (ListControllerTypes, "list_controller_types", self._types),
            (LoadController, "load_controller", self._service(self._load)),
            (ConfigureController, "configure_controller", self._service(lambda r: manager_client.configure(r.name))),
            (CleanupController, "cleanup_controller", self._service(lambda r: manager_client.cleanup(r.name))),
            (UnloadController, "unload_controller", self._service(lambda r: manager_client.unload(r.name))),
            (
                ReloadControllerLibraries,
                "reload_controller_libraries",
                self._service(lambda r: manager_client.reload(r.force_kill)),
            ),
            (SwitchController, "switch_controller", self._switch),
        ):
            self.node.create_service(kind, f"~/{name}", callback, qos_profile=EVERY_CALL, callback_group=group)

    def publish_cycle(self, state: JointState, stamp: Time) -> None:
        """Publish the interfaces and the times of a cycle if the parameter ``publish_introspection`` is set."""
        if self._introspection is not None:
            self._introspection.publish(state, stamp)

    def _introspect(self, stack: Stack) -> "Introspection | None":
        if find_spec("pal_statistics_msgs") is None:
            self.node.get_logger().error(f"publish_introspection needs pal_statistics_msgs: {INSTALL}")
            return None
        from nodes.manager.introspection import Introspection

        return Introspection(self.node, stack)

    def publish(self) -> None:
        """Publish ``~/activity`` if a controller or component has changed."""
        components = self._components()
        seen = (self._stack.loop.manager.registry.loaded, components)
        if self._published != seen:
            self._published = seen
            message = ControllerManagerActivity()
            message.header.stamp = self.node.get_clock().now().to_msg()
            loaded = self._stack.loop.manager.registry.loaded.values()
            message.controllers = [NamedLifecycleState(name=c.name, state=state_message(c.state)) for c in loaded]
            message.hardware_components = [NamedLifecycleState(name=n, state=state_message(s)) for n, s in components]
            self._activity.publish(message)

    def _declare(self, parameters: Mapping[str, Any]) -> None:
        """Declare the parameters in the controllers file, as ros2_control does, and declare the robot description in
        use."""
        rate = round(1.0 / self._stack.loop.period_s)
        fixed = {"update_rate": rate, "robot_description": self._stack.description.xml, "enforce_command_limits": True}
        fixed["publish_introspection"] = bool(parameters.get("publish_introspection", False))
        for name, value in fixed.items():
            self.node.declare_parameter(name, value, ParameterDescriptor(read_only=True))
        self._limit_messages(parameters)
        for name, value in _flat(parameters):
            if not self.node.has_parameter(name):
                self.node.declare_parameter(name, value, ParameterDescriptor(dynamic_typing=True))
        self.node.add_on_set_parameters_callback(_check_settings)

    def _limit_messages(self, parameters: Mapping[str, Any]) -> None:
        CLIENT_LIMITS.bytes = ManagerParameters.model_validate(dict(parameters)).max_message_size
        size = RANGES[PARAMETER]
        descriptor = ParameterDescriptor(
            description=f"Maximum size of a goal, command or request, in {size.unit}",
            additional_constraints=f"{size.lowest:g} to {size.highest:g}",
        )
        self.node.declare_parameter(PARAMETER, CLIENT_LIMITS.bytes, descriptor)
        self.node.add_on_set_parameters_callback(_check_size)
        self.node.add_post_set_parameters_callback(_set_size)

    def _setting(self, controller: str, key: str) -> Any:
        """Return the value of the parameter ``<controller>.<key>``, or None."""
        return self.node.get_parameter_or(f"{controller}.{key}").value if controller else None

    def _on_description(self, message: String) -> None:
        if message.data != self._stack.description.xml:
            self.node.get_logger().warning(
                f"a different robot description on {self.node.resolve_topic_name('robot_description')} is ignored: "
                "to use that description, start the stack with its URDF (servoloop up --urdf FILE)"
            )

    def _service(self, act: Callable[[Any], Request[None]]) -> Callable[[Any, Any], Awaitable[Any]]:
        """Create a service callback that responds with ``ok`` and logs the reason for a failure."""

        async def serve(request: Any, response: Any) -> Any:
            try:
                await self._pending.result(act(request))
                response.ok = True
            except Exception as error:  # A plugin may raise any exception.
                self.node.get_logger().error(printable(str(error)))
                response.ok = False
            return response

        return serve

    def _load(self, request: LoadController.Request) -> Request[None]:
        name = request.name
        settings = {key: value for key in SETTINGS if (value := self._setting(name, key)) is not None}
        return self._manager_client.load(name, ManagerSettings.of(settings))

    async def _switch(
        self, request: SwitchController.Request, response: SwitchController.Response
    ) -> SwitchController.Response:
        try:
            switch = SwitchRequest(
                tuple(request.activate_controllers), tuple(request.deactivate_controllers), self._strictness(request)
            )
            timeout_s = Duration.from_msg(request.timeout).nanoseconds * 1e-9
            response.message = await self._pending.result(self._manager_client.switch(switch, timeout_s))
            response.ok = True
        except Exception as error:
            self.node.get_logger().error(printable(str(error)))
            response.ok, response.message = False, str(error)
        return response

    def _strictness(self, request: SwitchController.Request) -> Strictness:
        if request.strictness == 0:
            self.node.get_logger().warning("strictness is not set: using BEST_EFFORT (1). Use strictness 2 for STRICT.")
            return Strictness.BEST_EFFORT
        return Strictness(request.strictness)

    def _types(
        self, request: ListControllerTypes.Request, response: ListControllerTypes.Response
    ) -> ListControllerTypes.Response:
        response.types = self._manager_client.controller_types()
        response.base_classes = [BASE_CLASS] * len(response.types)
        return response

    def _controllers(
        self, request: ListControllers.Request, response: ListControllers.Response
    ) -> ListControllers.Response:
        rate = round(1.0 / self._stack.loop.period_s)
        response.controller = [controller_message(c, rate) for c in self._stack.loop.manager.registry.loaded.values()]
        return response

    def _components(self) -> tuple[tuple[str, LifecycleState], ...]:
        return tuple((component.name, component.state) for component in self._stack.loop.hardware.components)


def controller_message(entry: Loaded, rate_hz: int) -> ControllerState:
    """Create the state message of a controller. Chained and asynchronous controllers are not supported."""
    return ControllerState(
        name=entry.name,
        state=entry.state.name.lower(),
        type=entry.spec.kind,
        update_rate=rate_hz,
        claimed_interfaces=list(entry.commands) if entry.active else [],
        required_command_interfaces=list(entry.commands),
        required_state_interfaces=list(entry.states),
    )


def _check_size(parameters: list[Parameter]) -> SetParametersResult:
    for parameter in parameters:
        if parameter.name == PARAMETER and (mistake := range_mistake(PARAMETER, parameter.value)):
            return SetParametersResult(successful=False, reason=f"{PARAMETER} {mistake}")
    return SetParametersResult(successful=True)


def _set_size(parameters: list[Parameter]) -> None:
    for parameter in parameters:
        if parameter.name == PARAMETER:
            CLIENT_LIMITS.bytes = parameter.value


def _check_settings(parameters: list[Parameter]) -> SetParametersResult:
    """Reject a setting such as ``<controller>.type`` if the controller could not be loaded with it."""
    for parameter in parameters:
        controller, _, key = parameter.name.partition(".")
        if not controller or key not in SETTINGS or parameter.type_ is Parameter.Type.NOT_SET:
            continue
        if mistake := setting_mistake(key, parameter.value):
            return SetParametersResult(successful=False, reason=f"{printable(parameter.name)} {mistake}")
    return SetParametersResult(successful=True)


def _flat(parameters: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in parameters.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{key}.")
        elif value is not None and value != []:
            yield f"{prefix}{key}", value
