"""``ros2 param``: list, read and set the parameters of a node."""

from typing import Annotated

import typer
import yaml
from rcl_interfaces.srv import GetParameters, ListParameters, SetParameters
from rclpy.parameter import Parameter, parameter_value_to_python

from servoloop_ros2.ros2_error import Ros2Error
from servoloop_ros2.session import session

app = typer.Typer(no_args_is_help=True, help="List, read and set the parameters of a node.")
Node = Annotated[str, typer.Argument(metavar="NODE", help="Name of the node.")]
Name = Annotated[str, typer.Argument(metavar="PARAMETER", help="Name of the parameter.")]


@app.command("list")
def list_parameters(node: Node) -> None:
    """List the parameters of a node."""
    with session() as found:
        names = found.call(ListParameters, f"{node}/list_parameters", ListParameters.Request()).result.names
    print("\n".join(f"  {name}" for name in sorted(names)))


@app.command()
def get(node: Node, name: Name) -> None:
    """Print the value of a parameter."""
    with session() as found:
        values = found.call(GetParameters, f"{node}/get_parameters", GetParameters.Request(names=[name])).values
    value = parameter_value_to_python(values[0]) if values else None
    if value is None:
        raise Ros2Error(f"{node} has no parameter {name}: list them with ros2 param list {node}")
    print(f"Value: {list(value) if hasattr(value, 'tolist') else value}")


@app.command("set", context_settings={"ignore_unknown_options": True})
def set_parameter(node: Node, name: Name, value: Annotated[str, typer.Argument(help="New value as YAML.")]) -> None:
    """Set a parameter. A negative number is a value and not an option."""
    request = SetParameters.Request(parameters=[Parameter(name, value=yaml.safe_load(value)).to_parameter_msg()])
    with session() as found:
        (result,) = found.call(SetParameters, f"{node}/set_parameters", request).results
    if not result.successful:
        raise Ros2Error(f"{name} was not set: {result.reason}")
    print("Set parameter successful")
