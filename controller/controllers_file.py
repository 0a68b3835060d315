"""The controllers file, in ros2_control's own format: read whole, and every mistake told with its line."""

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from controller.kinds import broken, kinds
from controller.node_parameters import Content, merged, names, parameters_of, read_content
from controller.order import Order
from controller.parameters import ManagerParameters, Parameters
from hal.description import Component
from hal.yaml_file import place

LOG = logging.getLogger("servoloop.controller")

MANAGER = "controller_manager"
GROUPS = ("defaults", "diagnostics", "hardware_components_initial_state", "overruns", "qos_overrides")
"""Groups of the manager's own parameters, which look like controllers."""
FOR_THE_MANAGER = ("type", "fallback_controllers", "params_file", "node_options_args")
"""What may stand among a controller's parameters for the spawner, and is not for the controller."""

Defaults = Mapping[str, Mapping[str, Any]]
"""By controller: what fills in where nobody says anything."""


class ControllersFileError(Exception):
    """The controllers file has mistakes; the text lists them with file and line."""


@dataclass(frozen=True, slots=True)
class ControllersFile:
    """The whole file, checked; ``content`` is all that it says, also of nodes that the manager does not name."""

    path: Path
    update_rate_hz: int
    controllers: tuple[Order, ...]
    content: Content = field(default_factory=dict)
    defaults: Defaults = field(default_factory=dict)

    @property
    def manager(self) -> Mapping[str, Any]:
        """The manager's own parameters."""
        return parameters_of(self.content, MANAGER)


def load_controllers_file(path: Path, defaults: Defaults, component: Component) -> ControllersFile:
    """Read and check the file; ``defaults`` by controller fill in what it does not say.

    Raises ControllersFileError with every mistake.
    """
    content = read_content(path, ControllersFileError)
    if not names(content, MANAGER):
        raise ControllersFileError(f"{path} has no {MANAGER}")
    reader = _Reader(path, content, component, [])
    controllers = reader.controllers(defaults)
    manager = reader.checked(MANAGER, ManagerParameters, parameters_of(content, MANAGER))
    if reader.problems or not isinstance(manager, ManagerParameters):
        raise ControllersFileError("\n".join(reader.problems))
    if not controllers:
        LOG.warning("%s: %s names no controllers: a spawner has to bring them", path, MANAGER)
    return ControllersFile(path, manager.update_rate, tuple(controllers), content, defaults)


def load_controller(
    file: ControllersFile,
    name: str,
    kind: str,
    paths: Sequence[Path],
    component: Component,
    given: Mapping[str, Any] | None = None,
) -> Order:
    """One controller; what ``paths`` say counts more than what ``file`` says, and parameters that are given most.

    Raises ControllersFileError with every mistake.
    """
    contents = [(path, read_content(path, ControllersFileError)) for path in paths]
    if paths and not any(names(content, name) or "/**" in content for _, content in contents):
        listed = ", ".join(map(str, paths))
        raise ControllersFileError(f"{listed} says nothing of {name}: give it a section '{name}: ros__parameters: …'")
    parameters = merged(file.defaults.get(name, {}), parameters_of(file.content, name))
    for said in (*(parameters_of(content, name) for _, content in contents), given or {}):
        parameters = merged(parameters, said)
    reader = _Reader(*(contents[-1] if contents else (file.path, file.content)), component, [])
    found = list(reader.controller(name, {**_entry(file.content, name), "type": kind}, parameters))
    if reader.problems:
        raise ControllersFileError("\n".join(reader.problems))
    return found[0]


def _entry(content: Content, name: str) -> Mapping[str, Any]:
    """What the manager's own section says of a controller."""
    said = parameters_of(content, MANAGER).get(name)
    return said if isinstance(said, Mapping) else {}


@dataclass(slots=True)
class _Reader:
    """One file being read, and the mistakes found so far."""

    path: Path
    content: Content
    component: Component
    problems: list[str]

    def say(self, node: str, key: str, text: str) -> None:
        """A mistake with file and line."""
        self.problems.append(f"{place(self.path, (node, 'ros__parameters', key))}: {node}.{key} {text}")

    def controllers(self, defaults: Defaults) -> list[Order]:
        """The controllers that the manager names and whose parameters are right."""
        found: list[Order] = []
        for name, said in parameters_of(self.content, MANAGER).items():
            if isinstance(said, Mapping) and name not in GROUPS:
                own = parameters_of(self.content, name)
                self._check_waits(name, own.get("wait_for"))
                found += self.controller(name, said, merged(defaults.get(name, {}), own))
        return found

    def checked(self, name: str, model: type[Parameters], parameters: Mapping[str, Any]) -> Parameters | None:
        """The parameters as ``model``, or None and each mistake noted."""
        try:
            return model.model_validate(dict(parameters))
        except ValidationError as error:
            for item in error.errors():
                where = place(self.path, (name, "ros__parameters", *item["loc"]))
                self.problems.append(f"{where}: {'.'.join((name, *map(str, item['loc'])))}: {item['msg']}")
            return None

    def controller(self, name: str, entry: Mapping[str, Any], parameters: Mapping[str, Any]) -> Iterator[Order]:
        """The controller, unless there are mistakes. ``entry`` is what the manager's section says of it."""
        kind = str(entry.get("type") or "")
        if kind not in kinds():
            what = f"unknown type '{kind}'" if kind else "no type"
            why = broken().get(kind) or f"has {what}, known types are {', '.join(kinds())}"
            self.say(MANAGER, name, why)
            return
        own = {key: value for key, value in parameters.items() if key not in FOR_THE_MANAGER}
        checked = self.checked(name, kinds()[kind].parameters_type, own)
        if checked is None:
            return
        self._check_claims(name, checked)
        if unused := checked.unused():
            LOG.warning("%s: %s: not used: %s", self.path, name, ", ".join(unused))
        fallback = entry.get("fallback_controllers") or ()
        yield Order(name, kind, checked, (fallback,) if isinstance(fallback, str) else tuple(fallback))

    def _check_waits(self, name: str, waits: Any) -> None:
        """Who waits for nobody does not wait. The robot file's defaults may name one that this file has not."""
        known = parameters_of(self.content, MANAGER)
        for other in waits if isinstance(waits, list) else []:
            if other == name or other not in known:
                self.say(name, "wait_for", f"names {other}, which is no other controller of this file")

    def _check_claims(self, name: str, parameters: Parameters) -> None:
        """Each command interface that it wants is one of the URDF's, and is wanted once."""
        joints, claims = self.component.joints, parameters.claims()
        key = "joint" if "joint" in type(parameters).model_fields else "joints"
        block = "the URDF's <ros2_control> block"
        for claim in dict.fromkeys(claims):
            joint = claim.rpartition("/")[0]
            if joint not in joints:
                self.say(name, key, f"names {joint}, which takes no commands in {block} (it has {', '.join(joints)})")
            elif claim not in self.component.commands:
                self.say(name, key, f"wants {claim}, which is no command_interface of {block}")
        for claim in sorted({claim for claim in claims if claims.count(claim) > 1}):
            self.say(name, key, f"names {claim.rpartition('/')[0]} twice")
