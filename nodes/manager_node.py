"""``/controller_manager``: who controls what, as ``ros2 control`` asks it."""

from controller_manager_msgs.msg import ControllerState, HardwareComponentState, HardwareInterface
from controller_manager_msgs.srv import (
    ListControllers,
    ListHardwareComponents,
    ListHardwareInterfaces,
)
from lifecycle_msgs.msg import State
from rclpy.node import Node

from controller.interface import Controller
from hal.lifecycle import LifecycleState
from nodes.stack import Stack


class ManagerNode:
    """The services that list. Switching and loading come with the full surface."""

    def __init__(self, stack: Stack) -> None:
        self.node = Node("controller_manager")
        self._stack = stack
        self.node.create_service(ListControllers, "~/list_controllers", self._controllers)
        self.node.create_service(ListHardwareComponents, "~/list_hardware_components", self._components)
        self.node.create_service(ListHardwareInterfaces, "~/list_hardware_interfaces", self._interfaces)

    def _controllers(
        self, request: ListControllers.Request, response: ListControllers.Response
    ) -> ListControllers.Response:
        controllers = self._stack.loop.manager.controllers.values()
        response.controller = [self._controller(controller) for controller in controllers]
        return response

    def _controller(self, controller: Controller) -> ControllerState:
        manager = self._stack.loop.manager
        active = manager.state(controller.name) is LifecycleState.ACTIVE
        commands = list(controller.command_interfaces)
        return ControllerState(
            name=controller.name,
            state=manager.state(controller.name).name.lower(),
            type=controller.kind,
            update_rate=round(1.0 / self._stack.loop.period_s),
            claimed_interfaces=commands if active else [],
            required_command_interfaces=commands,
            required_state_interfaces=list(controller.state_interfaces),
        )

    def _state_names(self) -> list[str]:
        by_joint = self._stack.component.state_interfaces
        return [f"{joint}/{name}" for joint, names in by_joint.items() for name in names]

    def _command_interfaces(self) -> list[HardwareInterface]:
        manager = self._stack.loop.manager
        claimed = {
            name
            for controller in manager.controllers.values()
            if manager.state(controller.name) is LifecycleState.ACTIVE
            for name in controller.command_interfaces
        }
        return [
            HardwareInterface(
                name=f"{joint}/{name}",
                data_type="double",
                is_available=True,
                is_claimed=f"{joint}/{name}" in claimed,
            )
            for joint, names in self._stack.component.command_interfaces.items()
            for name in names
        ]

    def _state_interfaces(self) -> list[HardwareInterface]:
        return [HardwareInterface(name=name, data_type="double", is_available=True) for name in self._state_names()]

    def _interfaces(
        self, request: ListHardwareInterfaces.Request, response: ListHardwareInterfaces.Response
    ) -> ListHardwareInterfaces.Response:
        response.command_interfaces = self._command_interfaces()
        response.state_interfaces = self._state_interfaces()
        return response

    def _components(
        self, request: ListHardwareComponents.Request, response: ListHardwareComponents.Response
    ) -> ListHardwareComponents.Response:
        component, state = self._stack.component, self._stack.loop.hardware.state
        response.component = [
            HardwareComponentState(
                name=component.name,
                type=component.kind,
                rw_rate=round(1.0 / self._stack.loop.period_s),
                plugin_name=component.plugin,
                state=State(id=state.value, label=state.name.lower()),
                command_interfaces=self._command_interfaces(),
                state_interfaces=self._state_interfaces(),
            )
        ]
        return response
