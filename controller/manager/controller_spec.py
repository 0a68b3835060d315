"""The spec of a controller, as a controllers file or a spawner gives it."""

from dataclasses import dataclass

from controller.parameters import Parameters


@dataclass(frozen=True, slots=True)
class ControllerSpec:
    """The name, type and checked parameters of a controller."""

    name: str
    kind: str
    parameters: Parameters
    fallback: tuple[str, ...] = ()
    """Controllers that take over when it fails."""
    node_arguments: tuple[str, ...] = ()
    """ROS arguments of its node (``--ros-args -r …``)."""
