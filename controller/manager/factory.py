"""The factory makes controllers from parameter files and spawners' arguments."""

from dataclasses import dataclass

from controller.interface import Controller, ControllerContext
from controller.manager.controller_spec import ControllerSpec
from controller.manager.controllers_file import ControllersFile, ControllersFileError, claim_mistakes, load_controller
from controller.manager.manager import ControllerManager
from controller.manager.plugins import controller_types
from controller.manager.settings import Settings


@dataclass(frozen=True, slots=True)
class Factory:
    """The factory makes controllers of one robot, those of the file and others."""

    file: ControllersFile
    context: ControllerContext

    def spec(self, name: str, settings: Settings) -> ControllerSpec:
        """The checked spec of a controller; what ``settings`` leave open, the controllers file may give.

        Raises ControllersFileError with every mistake, ValueError where an argument of the node is no YAML.
        """
        if name in settings.fallback:
            raise ControllersFileError(f"{name} cannot be its own fallback: name another controller")
        return load_controller(self.file, name, settings, self.context.component)

    def make(self, spec: ControllerSpec) -> Controller:
        """The controller, inactive. Raises ValueError where it does not fit the robot, or parameters are missing."""
        if missing := spec.parameters.missing():
            them = "them" if len(missing) > 1 else "it"
            raise ValueError(f"{spec.name} lacks {', '.join(missing)}: set {them} on its node /{spec.name}")
        for key, text in claim_mistakes(spec.parameters, self.context.component):
            raise ValueError(f"{spec.name}.{key} {text}")
        return controller_types()[spec.kind].build(spec.name, spec.parameters, self.context)

    def fill(self, manager: ControllerManager) -> None:
        """Load and configure all controllers of the file, in its order.

        Raises ControllersFileError where one does not fit the robot, ClaimError where it commands too much.
        """
        for spec in self.file.controllers:
            manager.registry.load(spec)
            manager.registry.configure(spec.name, self._made(spec))

    def _made(self, spec: ControllerSpec) -> Controller:
        try:
            return self.make(spec)
        except ValueError as error:
            raise ControllersFileError(f"{self.file.path}: {spec.name}: {error}") from error
