"""Implementation of ``servoloop topic-host``: run an arm under another program's controller manager."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from controller.host.host_controller import HostController
from controller.interface import limits_of
from drivers.driver_errors import DriverError
from hal.types import Interface, joints_of
from nodes.ros_environment import require_ros
from nodes.topic_host.topics import HostTopics
from servoloop.stack.control_stack import ControlStack
from servoloop.stack.hardware import HardwareKind
from servoloop.stack.robot_files import Files
from servoloop.stack.ros_interface import RosInterface
from servoloop.up import up
from servoloop.up_options import UpOptions

if TYPE_CHECKING:
    from nodes.only_one import Search
    from nodes.stack import Stack

NAME: Final = "host_controller"
"""Name of the controller that follows the commands."""


@dataclass(slots=True)
class ForeignControllers:
    """Controllers in another controller manager, which is connected to the stack by two topics."""

    topics: HostTopics
    record: Path | None = None
    """Path of the recording, if any."""
    search: "Search | None" = None
    """Running search for another topic-host, which was started before the hardware was opened."""
    controllers: list[HostController] = field(default_factory=list)
    """List that contains the controller that follows the commands; empty until that controller is loaded."""

    def load_controllers(self, stack: ControlStack) -> None:
        """Load the controller that follows the commands. Raises DriverError if no joint accepts position commands."""
        hardware = stack.loop.hardware
        positions = [name for name in hardware.command_interfaces if Interface.parse(name).kind == "position"]
        if not positions:
            raise DriverError(
                f"{stack.files.urdf_path} has no position command interface, which topic-host needs to move joints"
            )
        joints = joints_of(positions)
        others = stack.files.description.joints.keys() - set(joints)
        controller = HostController(NAME, joints, limits_of(joints, stack.files.limits), hardware.joints, others)
        stack.loop.manager.registry.add(controller)
        self.controllers.append(controller)

    def ros_interface(self, stack: "Stack") -> RosInterface:
        """Create the node with the two topics.

        Raises:
            RosError: ROS does not start, or the search has found another topic-host.
        """
        from nodes.topic_host.interface import TopicHostInterface

        if self.search is not None:
            self.search.finish()
        return TopicHostInterface(stack, self.controllers[0], self.topics)


def topic_host(
    kind: HardwareKind | None,
    ports: Mapping[str, str] | None,
    files: Files,
    ready: Callable[[str], None],
    program: ForeignControllers,
) -> int:
    """Run an arm under another controller manager until a signal arrives or a fault occurs.

    Args:
        kind: Hardware of all components. If None, each component uses the hardware specified by its own ``<plugin>``.
        ports: Devices, keyed by bus name; None for virtual servos.
        files: Files of the arm. The controllers in the controllers file are not used.
        ready: Function called with the stack's name and rate when the stack accepts commands.
        program: The other controller manager.

    Returns:
        Exit status.

    Raises:
        RosError: ROS 2 is missing or cannot be used.
    """
    require_ros()
    files = replace(files, controllers=replace(files.controllers, controllers=()))
    return up(kind, ports, files, ready, UpOptions(record=program.record), program)
