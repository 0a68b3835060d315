"""From what files and spawners say to controllers."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from controller.controllers_file import ControllersFile, ControllersFileError, load_controller
from controller.interface import Controller, Surroundings
from controller.kinds import kinds
from controller.manager import ControllerManager
from controller.node_parameters import parameters_in
from controller.order import Order

ROS_ARGUMENTS = "--ros-args"


def build(file: ControllersFile, surroundings: Surroundings) -> list[Controller]:
    """The controllers of the file, in its order."""
    return [Factory(file, surroundings).make(order) for order in file.controllers]


@dataclass(frozen=True, slots=True)
class Factory:
    """Makes controllers of one robot, those of the file and others."""

    file: ControllersFile
    surroundings: Surroundings

    def order(
        self,
        name: str,
        kind: str,
        paths: Sequence[Path] = (),
        fallback: Sequence[str] = (),
        node_arguments: Sequence[str] = (),
    ) -> Order:
        """What is to be made, checked. ``paths`` are parameter files, the last of which counts most.

        Raises ControllersFileError with every mistake.
        """
        given = parameters_in(node_arguments, name)
        order = load_controller(self.file, name, kind, paths, self.surroundings.component, given)
        arguments = tuple(node_arguments)
        if arguments and ROS_ARGUMENTS not in arguments:  # the spawner's user may leave it out, rcl asks for it
            arguments = (ROS_ARGUMENTS, *arguments)
        return replace(order, fallback=tuple(fallback) or order.fallback, node_arguments=arguments)

    def make(self, order: Order) -> Controller:
        """The controller, inactive. Raises ValueError where it does not fit the robot."""
        return kinds()[order.kind].build(order.name, order.parameters, self.surroundings)

    def fill(self, manager: ControllerManager) -> None:
        """Load and configure all controllers of the file, in its order.

        Raises ControllersFileError where one does not fit the robot, ClaimError where it commands too much.
        """
        for order in self.file.controllers:
            manager.load(order)
            manager.configure(order.name, self._made(order))

    def _made(self, order: Order) -> Controller:
        try:
            return self.make(order)
        except ValueError as error:
            raise ControllersFileError(f"{self.file.path}: {order.name}: {error}") from error
