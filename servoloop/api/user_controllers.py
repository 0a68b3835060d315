"""Controllers that a script loads to replace controllers of the controllers file."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from pydantic import ValidationError

from controller.interface import Controller, ControllerType
from controller.manager.claims import claim_mistakes
from controller.manager_errors import ManagerError
from servoloop.api.arm_errors import ArmEndedError, ArmInputError
from servoloop.api.stream_gate import InLoop, Takeover
from servoloop.stack.control_stack import ControlStack


def load_controller(
    stack: ControlStack, name: str, kind: ControllerType, parameters: Mapping[str, Any], in_loop: InLoop
) -> Controller:
    """Build a controller and load it, without activating it.

    Args:
        stack: Running stack.
        name: Name of the controller.
        kind: Class of the controller.
        parameters: Parameters of the controller, keyed by name.
        in_loop: Function that runs an action between two cycles.

    Raises:
        ArmInputError: The parameters are invalid, or a controller with this name is loaded already.
    """
    try:
        checked = kind.parameters_type.model_validate(dict(parameters))
        for key, text in claim_mistakes(checked, stack.files.component):
            raise ArmInputError(f"{name}.{key} {text}")
        made = kind.build(name, checked, stack.context)
    except ValidationError as error:
        problems = "; ".join(f"{'.'.join(map(str, one['loc']))}: {one['msg']}" for one in error.errors())
        raise ArmInputError(f"{name}: {problems}") from error
    except (ValueError, KeyError) as error:
        raise error if isinstance(error, ArmInputError) else ArmInputError(f"{name}: {error}") from error

    def add() -> None:
        try:
            stack.loop.manager.registry.add(made)
        except ManagerError as error:
            raise ArmInputError(str(error)) from error

    in_loop(add)
    return made


@contextmanager
def active_controller(stack: ControlStack, name: str, in_loop: InLoop) -> Iterator[None]:
    """Let a loaded controller drive its joints while the context is open. Raises ArmBusyError."""
    takeover = Takeover(stack, name)
    try:
        in_loop(takeover.take)
        yield
    finally:
        try:
            in_loop(takeover.give_back)
            in_loop(lambda: stack.loop.manager.registry.unload(name))
        except ArmEndedError:  # The loop deactivated the controller when it ended.
            pass
