"""In which states the hardware components begin."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from controller.controllers_file import ControllersFileError
from servoloop.files import Files


@dataclass(frozen=True, slots=True)
class InitialStates:
    """Which components do not become active at the start, by the controllers file."""

    unconfigured: Collection[str]
    inactive: Collection[str]


def initial_states(files: Files) -> InitialStates:
    """Upstream's ``hardware_components_initial_state`` of the manager. Raises ControllersFileError."""
    said = files.controllers.manager.get("hardware_components_initial_state") or {}
    where = f"{files.controllers.path}: hardware_components_initial_state"
    known = [component.name for component in files.description.components]
    lists: dict[str, list[str]] = {"unconfigured": [], "inactive": []}
    for state, names in said.items() if isinstance(said, Mapping) else [("", said)]:
        if state not in lists or not isinstance(names, list):
            raise ControllersFileError(f"{where} has the lists unconfigured and inactive, not {state or said}")
        if strangers := [str(name) for name in names if name not in known]:
            raise ControllersFileError(f"{where} names {', '.join(strangers)}: the URDF has {', '.join(known)}")
        lists[state] = names
    return InitialStates(**lists)
