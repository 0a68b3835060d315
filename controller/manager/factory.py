"""Build controllers from parameter files and spawner arguments."""

from dataclasses import dataclass

from controller.interface import Controller, ControllerContext
from controller.manager.claims import claim_mistakes
from controller.manager.controller_spec import ControllerSpec
from controller.manager.controllers_file import ControllersFile, load_controller
from controller.manager.manager import ControllerManager
from controller.manager.plugins import controller_types
from controller.manager.settings import ManagerSettings
from controller.manager_errors import ControllersFileError


@dataclass(frozen=True, slots=True)
class Factory:
    """Factory for the controllers of one robot, including controllers that are not in its controllers file."""

    file: ControllersFile
    context: ControllerContext

    def spec(self, name: str, settings: ManagerSettings) -> ControllerSpec:
        """Return a controller's validated spec. The controllers file provides settings that are not in ``settings``.

        Raises:
            ControllersFileError: The parameters have errors. The message lists all errors.
            ValueError: An argument of the node is not valid YAML.
        """
        if name in settings.fallback:
            raise ControllersFileError(f"{name} cannot be its own fallback: choose another controller")
        return load_controller(self.file, name, settings, self.context.component)

    def make(self, spec: ControllerSpec) -> Controller:
        """Build an inactive controller.

        Raises ValueError if the controller is not suitable for the robot or lacks parameters.
        """
        if missing := spec.parameters.missing():
            node = f"{self.file.namespace}/{spec.name}"
            them = "them" if len(missing) > 1 else "it"
            raise ValueError(f"{spec.name} requires {', '.join(missing)}: set {them} on its node {node}")
        for key, text in claim_mistakes(spec.parameters, self.context.component):
            raise ValueError(f"{spec.name}.{key} {text}")
        return controller_types()[spec.kind].build(spec.name, spec.parameters, self.context)

    def fill(self, manager: ControllerManager) -> None:
        """Load and configure all controllers in the file, in file order.

        Raises:
            ControllersFileError: A controller is not suitable for the robot.
            ClaimError: A controller claims an interface that the hardware does not have.
        """
        for spec in self.file.controllers:
            manager.registry.load(spec)
            manager.registry.configure(spec.name, self._made(spec))

    def _made(self, spec: ControllerSpec) -> Controller:
        try:
            return self.make(spec)
        except ValueError as error:
            raise ControllersFileError(f"{self.file.path}: {spec.name}: {error}") from error
