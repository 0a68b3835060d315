"""Replacements for ``launch`` and ``launch_ros``, because no wheels of these packages exist. The replacements record
the actions that a launch file requests.

Each class accepts exactly the arguments that the launch files use, with their names in ROS 2 Jazzy.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any


@dataclass
class LaunchContext:
    """Values of the launch arguments."""

    launch_configurations: dict[str, str] = field(default_factory=dict)


@dataclass
class LaunchDescription:
    """Return value of a launch file."""

    entities: list[Any]


@dataclass
class DeclareLaunchArgument:
    """Argument of ``ros2 launch``."""

    name: str
    default_value: str = field(kw_only=True)
    description: str = field(default="", kw_only=True)


@dataclass
class LaunchConfiguration:
    """Value of an argument, which is known only when the launch runs."""

    name: str

    def perform(self, context: LaunchContext) -> str:
        """Return the value."""
        return context.launch_configurations[self.name]


@dataclass
class IfCondition:
    """Condition for the execution of an action."""

    predicate: LaunchConfiguration

    def evaluate(self, context: LaunchContext) -> bool:
        """Accept only the values that the real class accepts."""
        return {"true": True, "false": False}[self.predicate.perform(context).lower()]


@dataclass(kw_only=True)
class OpaqueFunction:
    """Actions that depend on the arguments."""

    function: Callable[[LaunchContext], Sequence[Any]]


@dataclass(kw_only=True)
class Shutdown:
    """Action that ends the launch."""

    reason: str


@dataclass(kw_only=True)
class ExecutableInPackage:
    """Program in lib/PACKAGE."""

    package: str
    executable: str


@dataclass(kw_only=True)
class ExecuteProcess:
    """Program without ROS arguments."""

    cmd: list[Any]
    name: str
    output: str
    sigterm_timeout: str = "5"
    sigkill_timeout: str = "5"
    on_exit: Shutdown | None = None


@dataclass(kw_only=True)
class Node:
    """Program with ROS arguments."""

    package: str
    executable: str
    output: str
    parameters: list[Any]
    arguments: list[str] = field(default_factory=list)
    condition: IfCondition | None = None


@dataclass
class PythonLaunchDescriptionSource:
    """Path of another launch file."""

    location: str


@dataclass
class IncludeLaunchDescription:
    """Inclusion of another launch file."""

    launch_description_source: PythonLaunchDescriptionSource


MODULES: dict[str, tuple[type, ...]] = {
    "launch": (LaunchContext, LaunchDescription),
    "launch.actions": (DeclareLaunchArgument, ExecuteProcess, IncludeLaunchDescription, OpaqueFunction, Shutdown),
    "launch.conditions": (IfCondition,),
    "launch.launch_description_sources": (PythonLaunchDescriptionSource,),
    "launch.substitutions": (LaunchConfiguration,),
    "launch_ros": (),
    "launch_ros.actions": (Node,),
    "launch_ros.substitutions": (ExecutableInPackage,),
}


def modules() -> dict[str, ModuleType]:
    """Return the replacements as modules for ``sys.modules``."""
    made = {}
    for name, classes in MODULES.items():
        made[name] = ModuleType(name)
        vars(made[name]).update({one.__name__: one for one in classes})
    return made
