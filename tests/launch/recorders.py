"""Stands in for ``launch`` and ``launch_ros``, of which there are no wheels: keeps what a launch file asks for.

Each class takes the arguments that the launch files use, under the names that ROS 2 Jazzy gives them, and no others.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any


@dataclass
class LaunchContext:
    """The launch arguments' values."""

    launch_configurations: dict[str, str] = field(default_factory=dict)


@dataclass
class LaunchDescription:
    """What a launch file returns."""

    entities: list[Any]


@dataclass
class DeclareLaunchArgument:
    """An argument of ``ros2 launch``."""

    name: str
    default_value: str = field(kw_only=True)
    description: str = field(default="", kw_only=True)


@dataclass
class LaunchConfiguration:
    """An argument's value, known when the launch runs."""

    name: str

    def perform(self, context: LaunchContext) -> str:
        """The value."""
        return context.launch_configurations[self.name]


@dataclass
class IfCondition:
    """Whether an action is carried out."""

    predicate: LaunchConfiguration

    def evaluate(self, context: LaunchContext) -> bool:
        """Only the words that the real one takes."""
        return {"true": True, "false": False}[self.predicate.perform(context).lower()]


@dataclass(kw_only=True)
class OpaqueFunction:
    """Actions that depend on arguments."""

    function: Callable[[LaunchContext], Sequence[Any]]


@dataclass(kw_only=True)
class Shutdown:
    """The end of the launch."""

    reason: str


@dataclass(kw_only=True)
class ExecutableInPackage:
    """A program in lib/PACKAGE."""

    package: str
    executable: str


@dataclass(kw_only=True)
class ExecuteProcess:
    """A program."""

    cmd: list[Any]
    name: str
    output: str
    sigterm_timeout: str = "5"
    sigkill_timeout: str = "5"
    on_exit: Shutdown | None = None


@dataclass(kw_only=True)
class Node:
    """A program that takes ROS arguments."""

    package: str
    executable: str
    output: str
    parameters: list[Any]
    arguments: list[str] = field(default_factory=list)
    condition: IfCondition | None = None


@dataclass
class PythonLaunchDescriptionSource:
    """Another launch file."""

    location: str


@dataclass
class IncludeLaunchDescription:
    """Another launch file, within this one."""

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
    """For ``sys.modules``."""
    made = {}
    for name, classes in MODULES.items():
        made[name] = ModuleType(name)
        vars(made[name]).update({one.__name__: one for one in classes})
    return made
