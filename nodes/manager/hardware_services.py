"""Serve the hardware requests of ``ros2 control`` and the hardware spawner on ``/controller_manager``."""

from typing import Final

from controller_manager_msgs.msg import HardwareComponentState, HardwareInterface
from controller_manager_msgs.srv import ListHardwareComponents, ListHardwareInterfaces, SetHardwareComponentState
from lifecycle_msgs.msg import State
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node

from drivers.printable import printable_line
from hal.components.component import Component
from hal.lifecycle import LifecycleState
from hal.robot_description.hardware_info import HardwareInfo
from nodes.lifecycle_messages import state_message
from nodes.manager.pending_requests import PendingRequests
from nodes.publishing import EVERY_CALL
from nodes.stack import Stack

LONGEST_NAME: Final = 100
"""Maximum length of a name in a message, in characters, chosen so that the rest of the message fits."""


class HardwareServices:
    """Hardware services of ``/controller_manager``, which run in the ROS thread. A state change may take several
    seconds. Other requests are served during a state change."""

    def __init__(self, node: Node, stack: Stack, pending: PendingRequests) -> None:
        self._node = node
        self._stack = stack
        self._pending = pending
        group = ReentrantCallbackGroup()  # Other requests are served while one request waits.
        for kind, name, callback in (
            (ListHardwareComponents, "list_hardware_components", self._list_components),
            (ListHardwareInterfaces, "list_hardware_interfaces", self._list_interfaces),
            (SetHardwareComponentState, "set_hardware_component_state", self._set_state),
        ):
            node.create_service(kind, f"~/{name}", callback, qos_profile=EVERY_CALL, callback_group=group)

    def _pairs(self) -> list[tuple[HardwareInfo, Component]]:
        components = self._stack.loop.hardware.components
        return list(zip(self._stack.description.components, components, strict=True))

    def _list_components(
        self, request: ListHardwareComponents.Request, response: ListHardwareComponents.Response
    ) -> ListHardwareComponents.Response:
        rate_hz = 1.0 / self._stack.loop.period_s
        response.component = [
            HardwareComponentState(
                name=info.name,
                type=info.kind,
                rw_rate=max(1, round(rate_hz / component.cycles_per_update)),
                plugin_name=info.plugin,
                state=state_message(component.state),
                command_interfaces=self._commands(info, component),
                state_interfaces=_states(info, component),
            )
            for info, component in self._pairs()
        ]
        return response

    def _list_interfaces(
        self, request: ListHardwareInterfaces.Request, response: ListHardwareInterfaces.Response
    ) -> ListHardwareInterfaces.Response:
        for info, component in self._pairs():
            response.command_interfaces += self._commands(info, component)
            response.state_interfaces += _states(info, component)
        return response

    def _commands(self, info: HardwareInfo, component: Component) -> list[HardwareInterface]:
        claimed = self._stack.loop.manager.registry.claimed
        return [
            HardwareInterface(name=name, data_type="double", is_available=component.sound, is_claimed=name in claimed)
            for name in (*info.commands, *info.outputs)
        ]

    async def _set_state(
        self, request: SetHardwareComponentState.Request, response: SetHardwareComponentState.Response
    ) -> SetHardwareComponentState.Response:
        component = self._stack.loop.hardware.component(request.name)
        target = _target(request.target_state)
        response.ok = False
        if component is None:
            self._node.get_logger().error(
                printable_line(f"hardware component with name '{request.name}' does not exist")
            )
            return response
        if target is None:
            self._refuse(request)
        else:
            response.ok = await self._reached(request.name, target)
        response.state = state_message(component.state)
        return response

    async def _reached(self, name: str, target: LifecycleState) -> bool:
        try:
            await self._pending.result(self._stack.loop.component_transitions.ask(name, target, self._stack.relax))
        except Exception as error:  # A plugin may raise any exception.
            self._node.get_logger().error(printable_line(f"{name} was not set to {target.name.lower()}: {error}"))
            return False
        return True

    def _refuse(self, request: SetHardwareComponentState.Request) -> None:
        target, known = request.target_state, ", ".join(f"{s.value} {s.name.lower()}" for s in LifecycleState)
        name, label = request.name[:LONGEST_NAME], target.label[:LONGEST_NAME]
        text = f"{name} cannot be set to '{label}' (id {target.id}): use one of the states {known}"
        self._node.get_logger().error(printable_line(text))


def _target(state: State) -> LifecycleState | None:
    """Return the state with the given ID, or the state with the given label if the ID is 0."""
    return next(
        (s for s in LifecycleState if s.value == state.id or (not state.id and s.name.lower() == state.label)), None
    )


def _states(info: HardwareInfo, component: Component) -> list[HardwareInterface]:
    return [HardwareInterface(name=name, data_type="double", is_available=component.sound) for name in info.states]
