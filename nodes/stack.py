"""Define the parts of a running stack that the ROS nodes use."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

from controller.loop import ControlLoop
from controller.manager.factory import Factory
from controller.manager.requests import Request
from hal.robot_description.description import Description, HardwareInfo, Vector
from hal.robot_description.kinematics import Quaternion

Scene = Callable[[], Mapping[str, tuple[Vector, Quaternion]]]
"""Function that returns the poses of simulated objects in base_link (m; x, y, z, w), keyed by object name.

The result is empty for a real arm.
"""


class Simulation(Protocol):
    """Control of simulated time. All methods are thread-safe."""

    @property
    def paused(self) -> bool: ...

    def pause(self, paused: bool) -> None:
        """Pause simulated time after the current cycle, or resume it."""
        ...

    def step(self, cycles: int) -> Request[None]:
        """Run a number of cycles in a paused simulation. The request completes after the last of these cycles."""
        ...


@dataclass(frozen=True, slots=True)
class Stack:
    """One robot with its control loop, its description and, in a simulation, its scene."""

    loop: ControlLoop
    description: Description
    component: HardwareInfo
    """All hardware components, combined into one component."""
    servo_ids: Mapping[str, str]
    """Servo ID of each joint, prefixed with the bus name if buses are named (``hand/1``). Empty without servos."""
    scene: Scene
    set_compensation: Mapping[str, Callable[[bool], None]]
    """Functions that switch gravity compensation on or off, keyed by component name, for components with servos."""
    factory: Factory
    """Factory for the controllers that clients load."""
    relax: bool
    """Whether deactivating a component disables its torque, as ``on_exit`` in the robot file specifies."""
    publish_transforms: bool = True
    """Whether to publish ``robot_description`` and the link transforms."""
    simulation: Simulation | None = None
    """Control of simulated time. None if the loop runs in real time."""
    namespace: str = ""
    """Namespace of all nodes of the stack, such as ``/left``, or empty for the root namespace."""
