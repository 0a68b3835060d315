"""From the controllers file to the controllers."""

from controller.controllers_file import ControllersFile
from controller.interface import Controller, Surroundings
from controller.kinds import kinds


def build(file: ControllersFile, surroundings: Surroundings) -> list[Controller]:
    """The controllers of the file, in its order."""
    return [kinds()[c.kind].build(c.name, c.parameters, surroundings) for c in file.controllers]
