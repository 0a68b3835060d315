"""Controllers that a script loads to replace controllers of the controllers file."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any

from pydantic import ValidationError

from controller.interface import Controller, ControllerType
from controller.manager.claims import claim_mistakes
from controller.manager_errors import ManagerError
from hal.yaml_file import named_text
from servoloop.api.arm_errors import ArmEndedError, ArmInputError
from servoloop.api.stream_gate import InLoop, Takeover
from servoloop.stack.control_stack import ControlStack


def build_controller(stack: ControlStack, name: str, kind: ControllerType, parameters: Mapping[str, Any]) -> Controller:
    """Build a controller without loading it.

    Args:
        stack: Running stack.
        name: Name of the controller.
        kind: Class of the controller.
        parameters: Parameters of the controller, keyed by name.

    Raises:
        ArmInputError: The parameters are invalid.
    """
    try:
        checked = kind.parameters_type.model_validate(dict(parameters))
        for key, text in claim_mistakes(checked, stack.files.component):
            raise ArmInputError(f"{name}.{key} {text}")
        return kind.build(name, checked, stack.context)
    except ValidationError as error:
        problems = "; ".join(map(named_text, error.errors()))
        raise ArmInputError(f"{name}: {problems}") from None
    except (ValueError, KeyError) as error:
        raise error if isinstance(error, ArmInputError) else ArmInputError(f"{name}: {error}") from error


@contextmanager
def active_controller(stack: ControlStack, made: Controller, in_loop: InLoop) -> Iterator[None]:
    """Load a controller, and let it drive its joints while the context is open.

    An interrupt may arrive while an action waits for the loop. The loop still runs this action, and then ``remove``.

    Args:
        stack: Running stack.
        made: Controller.
        in_loop: Function that runs an action between two cycles.

    Raises:
        ArmInputError: A controller with this name is loaded already.
        ArmBusyError: The controller cannot be activated.
    """
    user = _UserController(stack, made)
    try:
        in_loop(user.add)
        in_loop(user.takeover.take)
        yield
    finally:
        with suppress(ArmEndedError):  # The loop deactivated the controller when it ended.
            in_loop(user.remove)


class _UserController:
    """Controller of a script. The loop's thread calls all methods between two cycles."""

    def __init__(self, stack: ControlStack, made: Controller) -> None:
        self.takeover = Takeover(stack, made.name)
        self._registry, self._made = stack.loop.manager.registry, made
        self._has_name = False

    def add(self) -> None:
        """Load the controller. Raises ArmInputError."""
        self._has_name = self._made.name not in self._registry.loaded
        try:
            self._registry.add(self._made)
        except ManagerError as error:
            raise ArmInputError(str(error)) from None

    def remove(self) -> None:
        """Activate the previous controllers, and unload the controller unless another program has unloaded it."""
        if not self._has_name:  # The loaded controller with this name is not the controller of the script.
            return
        self.takeover.give_back()
        if self._made.name in self._registry.loaded:
            self._registry.unload(self._made.name)
