"""The running stack as the wiring hands it to the ROS nodes."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

from controller.loop import ControlLoop
from controller.manager.factory import Factory
from controller.manager.requests import Request
from hal.robot_description.description import Description, HardwareInfo, Vector
from hal.robot_description.kinematics import Quaternion

Scene = Callable[[], Mapping[str, tuple[Vector, Quaternion]]]
"""Poses in base_link (m; x, y, z, w) of what a simulation knows beside the arm; empty on a real one."""


class Simulation(Protocol):
    """Simulated time as clients may hold it; for any thread."""

    @property
    def paused(self) -> bool: ...

    def pause(self, paused: bool) -> None:
        """Stop it behind the cycle that runs, or let it go on."""
        ...

    def step(self, cycles: int) -> Request[None]:
        """Run so many cycles of a paused simulation; the request is done behind the last one."""
        ...


@dataclass(frozen=True, slots=True)
class Stack:
    """One robot: its loop, its description, and the scene if there is a simulation below."""

    loop: ControlLoop
    description: Description
    component: HardwareInfo
    """All hardware components as one."""
    servo_ids: Mapping[str, str]
    """By joint: the ID, behind its bus where buses have names (``hand/1``). Empty where there are no servos."""
    scene: Scene
    set_compensation: Mapping[str, Callable[[bool], None]]
    """By component, where it has servos."""
    factory: Factory
    """Makes the controllers that clients load."""
    relax: bool
    """True if a component that is deactivated lets go of its joints, by the robot file's ``on_exit``."""
    publish_transforms: bool = True
    """True to publish the ``robot_description`` and the links' transforms."""
    simulation: Simulation | None = None
    """Where the loop's time is simulated, and with it all ROS time."""
