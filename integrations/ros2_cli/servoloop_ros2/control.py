"""``ros2 control``: list and switch controllers and hardware components."""

from collections.abc import Sequence
from typing import Annotated, Any, Final

import typer
from builtin_interfaces.msg import Duration
from controller_manager_msgs import srv
from lifecycle_msgs.msg import State

from servoloop_ros2.ros2_error import Ros2Error
from servoloop_ros2.session import RosSession, session

app = typer.Typer(no_args_is_help=True, help="List and switch controllers and hardware components.")
Manager = Annotated[str, typer.Option("--controller-manager", "-c", help="Name of the controller manager.")]
Controller = Annotated[str, typer.Argument(help="Name of the controller.")]
MANAGER: Final = "/controller_manager"
SWITCH_S: Final = 5
"""Maximum time for a switch, in seconds."""


def _ask(found: RosSession, manager: str, name: str, request: Any = None) -> Any:
    """Call a service of the manager. ``name`` is the service type. If ``request`` is None, send the default request."""
    kind = getattr(srv, name)
    snake = "".join(f"_{one.lower()}" if one.isupper() else one for one in name).lstrip("_")
    return found.call(kind, f"/{manager.lstrip('/')}/{snake}", request or kind.Request())


@app.command("list_controllers")
def list_controllers(manager: Manager = MANAGER) -> None:
    """List the loaded controllers, their types and states."""
    with session() as found:
        listed = _ask(found, manager, "ListControllers").controller
    for row in _columns([(one.name, one.type, one.state) for one in listed]):
        print(row)


@app.command("list_controller_types")
def list_controller_types(manager: Manager = MANAGER) -> None:
    """List the controller types that can be loaded."""
    with session() as found:
        listed = _ask(found, manager, "ListControllerTypes")
    for row in _columns(list(zip(listed.types, listed.base_classes, strict=True))):
        print(row)


@app.command("list_hardware_components")
def list_hardware_components(manager: Manager = MANAGER) -> None:
    """List the hardware components, their states and command interfaces."""
    with session() as found:
        listed = _ask(found, manager, "ListHardwareComponents").component
    for number, one in enumerate(listed, 1):
        print(f"Hardware Component {number}\n\tname: {one.name}\n\ttype: {one.type}")
        print(f"\tplugin name: {one.plugin_name}\n\tstate: id={one.state.id} label={one.state.label}")
        print(f"\tread/write rate: {one.rw_rate} Hz\n\tis_async: {one.is_async}\n\tcommand interfaces")
        for interface in one.command_interfaces:
            print(f"\t\t{_interface(interface)}")


@app.command("list_hardware_interfaces")
def list_hardware_interfaces(manager: Manager = MANAGER) -> None:
    """List the command and state interfaces."""
    with session() as found:
        listed = _ask(found, manager, "ListHardwareInterfaces")
    print("command interfaces")
    for one in sorted(listed.command_interfaces, key=lambda one: one.name):
        print(f"\t{_interface(one)}")
    print("state interfaces")
    for one in sorted(listed.state_interfaces, key=lambda one: one.name):
        print(f"\t{one.name}")


@app.command("load_controller")
def load_controller(name: Controller, manager: Manager = MANAGER) -> None:
    """Load a controller."""
    with session() as found:
        _require(
            _ask(found, manager, "LoadController", srv.LoadController.Request(name=name)), f"{name} was not loaded"
        )
    print(f"Successfully loaded controller {name}")


@app.command("unload_controller")
def unload_controller(name: Controller, manager: Manager = MANAGER) -> None:
    """Unload a controller."""
    request = srv.UnloadController.Request(name=name)
    with session() as found:
        _require(_ask(found, manager, "UnloadController", request), f"{name} was not unloaded")
    print(f"Successfully unloaded controller {name}")


@app.command("set_controller_state")
def set_controller_state(
    name: Controller,
    state: Annotated[str, typer.Argument(help="inactive or active.")],
    manager: Manager = MANAGER,
) -> None:
    """Configure, activate or deactivate a controller."""
    if state not in ("inactive", "active"):
        raise Ros2Error(f"{state} is not a state that can be set: write inactive or active")
    with session() as found:
        listed = {one.name: one.state for one in _ask(found, manager, "ListControllers").controller}
        if name not in listed:
            raise Ros2Error(f"no controller {name} is loaded: list them with ros2 control list_controllers")
        if listed[name] == "unconfigured":
            request = srv.ConfigureController.Request(name=name)
            _require(_ask(found, manager, "ConfigureController", request), f"{name} was not configured")
        if state == "active" != listed[name]:
            _switch(found, manager, [name], [])
        elif state == "inactive" and listed[name] == "active":
            _switch(found, manager, [], [name])
    print(f"Successfully set {name} to {state}")


@app.command("switch_controllers")
def switch_controllers(
    activate: Annotated[list[str] | None, typer.Option(help="Controller to activate. Can be repeated.")] = None,
    deactivate: Annotated[list[str] | None, typer.Option(help="Controller to deactivate. Can be repeated.")] = None,
    manager: Manager = MANAGER,
) -> None:
    """Activate and deactivate controllers in one step."""
    with session() as found:
        _switch(found, manager, activate or [], deactivate or [])
    print("Successfully switched controllers")


@app.command("set_hardware_component_state")
def set_hardware_component_state(
    name: Annotated[str, typer.Argument(help="Name of the hardware component.")],
    state: Annotated[str, typer.Argument(help="unconfigured, inactive or active.")],
    manager: Manager = MANAGER,
) -> None:
    """Set the state of a hardware component."""
    request = srv.SetHardwareComponentState.Request(name=name, target_state=State(label=state))
    with session() as found:
        answer = _ask(found, manager, "SetHardwareComponentState", request)
    _require(answer, f"{name} was not set to {state}; its state is {answer.state.label or 'unknown'}")
    print(f"Successfully set {name} to {answer.state.label}")


def _switch(found: RosSession, manager: str, activate: Sequence[str], deactivate: Sequence[str]) -> None:
    kind = srv.SwitchController.Request
    request = kind(
        activate_controllers=list(activate),
        deactivate_controllers=list(deactivate),
        strictness=kind.STRICT,
        activate_asap=True,
        timeout=Duration(sec=SWITCH_S),
    )
    answer = _ask(found, manager, "SwitchController", request)
    _require(answer, f"the controllers were not switched: {answer.message}")


def _require(answer: Any, failure: str) -> None:
    if not answer.ok:
        raise Ros2Error(f"{failure}: see the log of the controller manager")


def _interface(one: Any) -> str:
    available = "[available]" if one.is_available else "[unavailable]"
    return f"{one.name} {available} {'[claimed]' if one.is_claimed else '[unclaimed]'}"


def _columns(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return the rows of a table with columns of equal width."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
