"""Requests of a client to ``/controller_manager`` about hardware and controllers."""

from typing import Any

from controller_manager_msgs.srv import (
    ListControllers,
    ListHardwareComponents,
    ListHardwareInterfaces,
    SetHardwareComponentState,
    SwitchController,
)
from lifecycle_msgs.msg import State

from tests.ros.stack_process import ArmClient

STRICT = 2


def ask(client: ArmClient, kind: Any, service_name: str, **request: Any) -> Any:
    service = client.node.create_client(kind, f"/controller_manager/{service_name}")
    assert service.wait_for_service(30.0)
    answer = client.wait(service.call_async(kind.Request(**request)))
    client.node.destroy_client(service)
    return answer


def components(client: ArmClient) -> dict[str, str]:
    listed = ask(client, ListHardwareComponents, "list_hardware_components").component
    return {component.name: component.state.label for component in listed}


def controllers(client: ArmClient) -> dict[str, str]:
    return {c.name: c.state for c in ask(client, ListControllers, "list_controllers").controller}


def set_state(client: ArmClient, name: str, target: int = 0, label: str = "") -> tuple[bool, str]:
    state = State(id=target, label=label)
    answer = ask(client, SetHardwareComponentState, "set_hardware_component_state", name=name, target_state=state)
    return answer.ok, answer.state.label


def activate(client: ArmClient, *names: str) -> tuple[bool, str]:
    answer = ask(client, SwitchController, "switch_controller", activate_controllers=list(names), strictness=STRICT)
    return answer.ok, answer.message


def interfaces(client: ArmClient, joint: str) -> dict[str, tuple[bool, bool]]:
    """Return whether each command interface (``commands/joint1/position``) and state interface is available and
    claimed."""
    answer = ask(client, ListHardwareInterfaces, "list_hardware_interfaces")
    return {
        f"{kind}/{i.name}": (i.is_available, i.is_claimed)
        for kind, listed in (("commands", answer.command_interfaces), ("states", answer.state_interfaces))
        for i in listed
        if i.name.startswith(joint)
    }
