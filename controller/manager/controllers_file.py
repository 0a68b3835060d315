"""The controllers file, in ros2_control's own format: read whole, and every mistake told with its line."""

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from controller.manager.controller_spec import ControllerSpec, name_mistake
from controller.manager.node_parameters import Content, merged, names, parameters_of
from controller.manager.parameter_file import ALL, PARAMETERS, read_parameter_file
from controller.manager.plugins import broken_plugins, controller_types
from controller.parameters import ManagerParameters, Parameters, ros_mistakes
from hal.robot_description.description import HardwareInfo
from hal.yaml_file import YamlFile, mistakes

LOG = logging.getLogger("servoloop.controller")

MANAGER = "controller_manager"
GROUPS = ("defaults", "diagnostics", "hardware_components_initial_state", "overruns", "qos_overrides")
"""Groups of the manager's own parameters, which look like controllers."""
FOR_THE_MANAGER = ("type", "fallback_controllers", "params_file", "node_options_args")
"""Names among a controller's parameters that are for the spawner, and not for the controller."""

Defaults = Mapping[str, Mapping[str, Any]]
"""By controller: the values of parameters that no file gives."""


class ControllersFileError(Exception):
    """The controllers file has mistakes; the text lists them with file and line."""


@dataclass(frozen=True, slots=True)
class ControllersFile:
    """The whole file, checked; ``content`` is all that it says, also of nodes that the manager does not name."""

    yaml: YamlFile
    update_rate_hz: int
    controllers: tuple[ControllerSpec, ...]
    content: Content = field(default_factory=dict)
    defaults: Defaults = field(default_factory=dict)

    @property
    def path(self) -> Path:
        """The path of the file."""
        return self.yaml.path

    @property
    def manager(self) -> Mapping[str, Any]:
        """The manager's own parameters."""
        return parameters_of(self.content, MANAGER)


def load_controllers_file(path: Path, defaults: Defaults, component: HardwareInfo) -> ControllersFile:
    """Read and check the file; ``defaults`` by controller fill in missing parameters.

    Raises ControllersFileError with every mistake.
    """
    file, content = read_parameter_file(path, ControllersFileError)
    if not names(content, MANAGER):
        raise ControllersFileError(f"{path} has no {MANAGER}")
    reader = _Reader(file, content, component, [])
    controllers = reader.controllers(defaults)
    manager = reader.checked(MANAGER, ManagerParameters, parameters_of(content, MANAGER))
    if reader.problems or not isinstance(manager, ManagerParameters):
        raise ControllersFileError("\n".join(reader.problems))
    if not controllers:
        LOG.warning("%s: %s names no controllers: a spawner has to bring them", path, MANAGER)
    return ControllersFile(file, manager.update_rate, tuple(controllers), content, defaults)


def load_controller(
    file: ControllersFile,
    name: str,
    kind: str,
    paths: Sequence[Path],
    component: HardwareInfo,
    given: Mapping[str, Any] | None = None,
) -> ControllerSpec:
    """One controller's spec; ``paths`` count more than ``file``, and parameters that are ``given`` count most.

    Required parameters may still be missing. Raises ControllersFileError with every other mistake.
    """
    contents = [read_parameter_file(path, ControllersFileError) for path in paths]
    if paths and not any(names(content, name) or ALL in content for _, content in contents):
        listed = ", ".join(map(str, paths))
        raise ControllersFileError(f"{listed} says nothing of {name}: give it a section '{name}: ros__parameters: …'")
    parameters = merged(file.defaults.get(name, {}), parameters_of(file.content, name))
    for said in (*(parameters_of(content, name) for _, content in contents), given or {}):
        parameters = merged(parameters, said)
    reader = _Reader(*(contents[-1] if contents else (file.yaml, file.content)), component, [], complete=False)
    found = list(reader.controller(name, {**_entry(file.content, name), "type": kind}, parameters))
    if reader.problems:
        raise ControllersFileError("\n".join(reader.problems))
    return found[0]


def _entry(content: Content, name: str) -> Mapping[str, Any]:
    """The entry of a controller in the manager's own section."""
    said = parameters_of(content, MANAGER).get(name)
    return said if isinstance(said, Mapping) else {}


@dataclass(slots=True)
class _Reader:
    """One file being read, and the mistakes found so far."""

    file: YamlFile
    content: Content
    component: HardwareInfo
    problems: list[str]
    complete: bool = True
    """Whether a required parameter that is missing is a mistake."""

    def say(self, node: str, key: str, text: str) -> None:
        """A mistake with file and line."""
        self.problems.append(f"{self.file.place((node, PARAMETERS, *key.split('.')))}: {node}.{key} {text}")

    def controllers(self, defaults: Defaults) -> list[ControllerSpec]:
        """The controllers that the manager names and whose parameters are right."""
        found: list[ControllerSpec] = []
        for name, said in parameters_of(self.content, MANAGER).items():
            if isinstance(said, Mapping) and name not in GROUPS:
                own = parameters_of(self.content, name)
                self._check_waits(name, own.get("wait_for"))
                found += self.controller(name, said, merged(defaults.get(name, {}), own))
        return found

    def checked(self, name: str, model: type[Parameters], parameters: Mapping[str, Any]) -> Parameters | None:
        """The parameters as ``model``, or None and each mistake noted."""
        try:
            return model.model_validate(dict(parameters)) if self.complete else model.as_far_as_given(parameters)
        except ValidationError as error:
            self.problems += mistakes(self.file, error, (name, PARAMETERS), name)
            return None

    def controller(
        self, name: str, entry: Mapping[str, Any], parameters: Mapping[str, Any]
    ) -> Iterator[ControllerSpec]:
        """The controller, unless there are mistakes. ``entry`` is its entry in the manager's section."""
        kind = str(entry.get("type") or "")
        if kind not in controller_types():
            what = f"unknown type '{kind}'" if kind else "no type"
            why = broken_plugins().get(kind) or f"has {what}, known types are {', '.join(controller_types())}"
            self.say(MANAGER, name, why)
            return
        if mistake := name_mistake(str(name)):
            self.say(MANAGER, name, mistake)
            return
        own = {key: value for key, value in parameters.items() if key not in FOR_THE_MANAGER}
        impossible = list(ros_mistakes(own))
        for key, text in impossible:
            self.say(name, key, text)
        checked = None if impossible else self.checked(name, controller_types()[kind].parameters_type, own)
        if checked is None:
            return
        if missing := checked.missing():
            LOG.info("%s is loaded without %s: to be set on its node before it is configured", name, ", ".join(missing))
        else:
            self._check_use(name, checked)
        fallback = entry.get("fallback_controllers") or ()
        yield ControllerSpec(name, kind, checked, (fallback,) if isinstance(fallback, str) else tuple(fallback))

    def _check_use(self, name: str, parameters: Parameters) -> None:
        for key, text in claim_mistakes(parameters, self.component):
            self.say(name, key, text)
        if unused := parameters.unused():
            LOG.warning("%s: %s: not used: %s", self.file.path, name, ", ".join(unused))

    def _check_waits(self, name: str, waits: Any) -> None:
        """A controller must wait for another of this file; the robot file's defaults may name one that is not there."""
        known = parameters_of(self.content, MANAGER)
        for other in waits if isinstance(waits, list) else []:
            if other == name or other not in known:
                self.say(name, "wait_for", f"names {other}, which is no other controller of this file")


def claim_mistakes(parameters: Parameters, component: HardwareInfo) -> Iterator[tuple[str, str]]:
    """Each claimed command interface must be one of the URDF's, and claimed once; yields parameter and mistake."""
    joints, claims = component.joints, parameters.claims()
    key = "joint" if "joint" in type(parameters).model_fields else "joints"
    block = "the URDF's <ros2_control> block"
    for claim in dict.fromkeys(claims):
        joint = claim.rpartition("/")[0]
        if joint not in joints:
            yield key, f"names {joint}, which takes no commands in {block} (it has {', '.join(joints)})"
        elif claim not in component.commands:
            yield key, f"wants {claim}, which is no command_interface of {block}"
    for claim in sorted({claim for claim in claims if claims.count(claim) > 1}):
        yield key, f"names {claim.rpartition('/')[0]} twice"
