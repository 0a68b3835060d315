"""A controller as it is ordered."""

from dataclasses import dataclass

from controller.parameters import Parameters


@dataclass(frozen=True, slots=True)
class Order:
    """Its name, type and checked parameters."""

    name: str
    kind: str
    parameters: Parameters
    fallback: tuple[str, ...] = ()
    """Who takes over when it fails."""
    node_arguments: tuple[str, ...] = ()
    """ROS arguments of its node (``--ros-args -r …``)."""
