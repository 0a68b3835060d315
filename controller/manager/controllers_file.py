"""Read and check a controllers file in the format of ros2_control. Every mistake is reported with its line."""

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from controller.manager.controller_spec import ControllerSpec, name_mistake, with_ros_flag
from controller.manager.node_parameters import Content, files_in, merged, names, parameters_in, parameters_of
from controller.manager.parameter_file import ALL, MOST_NODES, PARAMETERS, read_parameter_file
from controller.manager.plugins import SUCCESSORS, broken_plugins, controller_types, outdated
from controller.manager.settings import SETTINGS, ManagerSettings, setting_mistakes
from controller.parameters import ManagerParameters, Parameters, ros_mistakes
from hal.file_size import check_existing
from hal.robot_description.description import HardwareInfo
from hal.types import Interface
from hal.yaml_file import YamlPlaces, mistakes
from hal.yaml_nodes import YamlFile

LOG = logging.getLogger("servoloop.controller")

MANAGER = "controller_manager"
GROUPS = ("defaults", "diagnostics", "hardware_components_initial_state", "overruns", "qos_overrides")
"""Groups of manager parameters that look like controllers in the file."""
DEFAULTS = "controller_defaults"
"""Key of the robot file for default parameters of controllers."""
HONORED = ("hardware_components_initial_state", "qos_overrides", "robot_description", "use_sim_time")
"""Parameters of the manager that have an effect or that every node has."""

Defaults = Mapping[str, Mapping[str, Any]]
"""Default parameter values, by controller name and parameter name."""


class ControllersFileError(Exception):
    """The controllers file has mistakes. The message lists each mistake with file and line."""


@dataclass(frozen=True, slots=True)
class ControllersFile:
    """A checked controllers file. ``content`` also holds the parameters of nodes that are not controllers."""

    yaml: YamlFile
    update_rate_hz: int
    controllers: tuple[ControllerSpec, ...]
    content: Content = field(default_factory=dict)
    defaults: Defaults = field(default_factory=dict)

    @property
    def path(self) -> Path:
        """Path of the file."""
        return self.yaml.path

    @property
    def manager(self) -> Mapping[str, Any]:
        """Parameters of the manager itself."""
        return parameters_of(self.content, MANAGER)


@dataclass(frozen=True, slots=True)
class _FileWithDefaults:
    """Locations of parameters in the controllers file, or in the robot file for default values."""

    file: YamlFile
    content: Content
    defaults: YamlPlaces

    def place(self, location: Sequence[int | str]) -> str:
        node, _, *keys = location
        if keys and str(keys[0]) not in parameters_of(self.content, str(node)):
            return self.defaults.place((DEFAULTS, node, *keys))
        return self.file.place(location)


def load_controllers_file(
    path: Path, defaults: Defaults, component: HardwareInfo, origin: YamlPlaces | None = None
) -> ControllersFile:
    """Read and check a controllers file.

    Args:
        path: Path of the file.
        defaults: Default parameter values, by controller name.
        component: The joints and interfaces of the robot.
        origin: Robot file that provides the defaults.

    Raises:
        ControllersFileError: The file has mistakes. The message lists all mistakes.
    """
    file, content = read_parameter_file(path, ControllersFileError)
    if not names(content, MANAGER):
        raise ControllersFileError(f"{path}:1: the file has no {MANAGER} section: add one that lists the controllers")
    places = file if origin is None else _FileWithDefaults(file, content, origin)
    reader = _Reader(file, content, component, [], places)
    controllers = reader.controllers(defaults)
    manager = reader.checked(MANAGER, ManagerParameters, parameters_of(content, MANAGER))
    if reader.problems or not isinstance(manager, ManagerParameters):
        raise ControllersFileError("\n".join(reader.problems))
    reader.name_unused(manager)
    if not controllers:
        LOG.warning("%s: %s lists no controllers: load them with a spawner", path, MANAGER)
    return ControllersFile(file, manager.update_rate, tuple(controllers), content, defaults)


def load_controller(
    file: ControllersFile, name: str, settings: ManagerSettings, component: HardwareInfo
) -> ControllerSpec:
    """Build the spec of one controller. Required parameters may still be missing.

    Args:
        file: The controllers file of the robot.
        name: Name of the controller.
        settings: Settings that override those in ``file``, as do their parameter files.
        component: The joints and interfaces of the robot.

    Raises:
        ControllersFileError: The parameters have mistakes. The message lists all mistakes.
        ValueError: An argument of the node is not valid YAML.
    """
    source = _Source(file.yaml, file.content, file.defaults, file.manager)
    settings = settings.over(ManagerSettings.of(source.entry(name)))
    last, content, parameters = source.parameters(name, settings)
    reader = _Reader(last, content, component, [], last, complete=False)
    found = list(reader.controller(name, settings, parameters))
    if reader.problems:
        raise ControllersFileError("\n".join(reader.problems))
    return found[0]


@dataclass(frozen=True, slots=True)
class _Source:
    """The controllers file and the robot file's defaults, before a controller's parameter files are merged in."""

    file: YamlFile
    content: Content
    defaults: Defaults
    manager: Mapping[str, Any]
    """Parameters of the manager itself, from ``content``."""

    def entry(self, name: str) -> dict[str, Any]:
        """Return the settings of a controller. The manager's section overrides the controller's own section."""
        found: dict[str, Any] = {}
        for _, _, settings in self.sections(name):
            found |= settings
        return found

    def sections(self, name: str) -> Iterator[tuple[str, str, dict[str, Any]]]:
        """Yield the settings from the controller's own section, then from the manager's section.

        Each item holds the node of the section, the prefix of the keys, and the settings.
        """
        own, entry = parameters_of(self.content, name), self.manager.get(name)
        yield name, "", {key: own[key] for key in SETTINGS if key in own}
        yield MANAGER, f"{name}.", dict(entry) if isinstance(entry, Mapping) else {}

    def controllers(self) -> list[str]:
        """Return the names of controllers listed by the manager, and of sections with a controller type."""
        named = [n for n, entry in self.manager.items() if isinstance(entry, Mapping)]
        own = [n.removeprefix("/") for n in self.content if n.removeprefix("/").isidentifier()]
        known = {*controller_types(), *SUCCESSORS}
        typed = [n for n in own if n not in named and parameters_of(self.content, n).get("type") in known]
        return [name for name in dict.fromkeys([*named, *typed]) if name not in GROUPS]

    def parameters(self, name: str, settings: ManagerSettings) -> tuple[YamlFile, Content, dict[str, Any]]:
        """Return the file with the highest priority, its content, and the merged parameters of a controller.

        Raise ControllersFileError or ValueError.
        """
        given, paths = parameters_in(settings.node_arguments, name), settings.files
        for path in files_in(settings.node_arguments):
            check_existing(path, ControllersFileError)
        contents = [read_parameter_file(path, ControllersFileError) for path in paths]
        if paths and not any(names(content, name) or ALL in content for _, content in contents):
            listed = ", ".join(map(str, paths))
            raise ControllersFileError(f"{listed} has no section for {name}: add '{name}: ros__parameters: …'")
        found = merged(self.defaults.get(name, {}), parameters_of(self.content, name))
        for parameters in (*(parameters_of(content, name) for _, content in contents), given):
            found = merged(found, parameters)
        return (*(contents[-1] if contents else (self.file, self.content)), found)


def no_type(name: str) -> str:
    """Return the error for a controller without a type. The text starts with ros2_control's own message."""
    return (
        f"The 'type' param was not defined for '{name}': set {name}.type on /controller_manager, "
        "or give the controller a section with its type in a parameter file"
    )


@dataclass(slots=True)
class _Reader:
    """Reader of one controllers file. It collects the mistakes."""

    file: YamlFile
    content: Content
    component: HardwareInfo
    problems: list[str]
    places: YamlPlaces
    complete: bool = True
    """Whether a required parameter that is missing is a mistake."""

    def report(self, node: str, key: str, text: str) -> None:
        """Record a mistake with its file and line."""
        self.problems.append(f"{self.places.place((node, PARAMETERS, *key.split('.')))}: {node}.{key} {text}")

    def controllers(self, defaults: Defaults) -> list[ControllerSpec]:
        """Return the specs of all controllers whose parameters are valid."""
        source = _Source(self.file, self.content, defaults, parameters_of(self.content, MANAGER))
        known = source.controllers()
        if len(known) > MOST_NODES:
            place = self.file.place((MANAGER, PARAMETERS, known[MOST_NODES]))
            raise ControllersFileError(f"{place}: {MANAGER} has more than {MOST_NODES} controllers: remove some")
        found: list[ControllerSpec] = []
        for name in known:
            entry = source.entry(name)
            waits = parameters_of(self.content, name).get("wait_for")
            for other in self._not_in_file(name, waits, known):
                self.report(name, "wait_for", f"names {other}, which is not another controller in this file")
            if self._settings_wrong(source, name):
                continue
            settings = ManagerSettings.of(entry)
            for other in self._not_in_file(name, settings.fallback, known):
                key = f"{name}.fallback_controllers"
                self.report(
                    MANAGER, key, f"names {other}, which is not another controller in this file: correct the name"
                )
            try:
                last, content, parameters = source.parameters(name, settings)
            except (ControllersFileError, ValueError) as error:
                self.report(MANAGER, name, f"cannot be loaded: {error}")
                continue
            places = self.places if last is self.file else last
            reader = _Reader(last, content, self.component, self.problems, places)
            found += reader.controller(name, settings, parameters)
        return found

    def _settings_wrong(self, source: _Source, name: str) -> bool:
        """Record the mistakes in the settings of a controller. Return whether there are mistakes."""
        known = len(self.problems)
        for node, prefix, settings in source.sections(name):
            for key, text in setting_mistakes(settings):
                self.report(node, f"{prefix}{key}", text)
        return len(self.problems) > known

    def name_unused(self, manager: ManagerParameters) -> None:
        """Log the manager parameters that have no effect."""
        extra = manager.model_extra or {}
        unused = [key for key in manager.unused() if key in GROUPS or not isinstance(extra[key], Mapping)]
        if unused := [key for key in unused if key not in HONORED]:
            LOG.warning("%s: %s: parameters without effect: %s", self.file.path, MANAGER, ", ".join(unused))
        if not manager.enforce_command_limits:
            LOG.warning(
                "%s: %s: enforce_command_limits: false has no effect: the limits of the robot description always apply",
                *(self.file.path, MANAGER),
            )

    def checked(self, name: str, model: type[Parameters], parameters: Mapping[str, Any]) -> Parameters | None:
        """Return the parameters as a ``model``. If they are invalid, record each mistake and return None."""
        try:
            return model.model_validate(dict(parameters)) if self.complete else model.as_far_as_given(parameters)
        except ValidationError as error:
            self.problems += mistakes(self.places, error, (name, PARAMETERS), name)
            return None

    def controller(
        self, name: str, settings: ManagerSettings, parameters: Mapping[str, Any]
    ) -> Iterator[ControllerSpec]:
        """Yield the spec of a controller, unless it has mistakes."""
        kind = settings.kind
        if kind in SUCCESSORS and self.complete:
            LOG.error("%s: %s is not loaded: %s", self.file.path, name, outdated(kind))
            return
        if not kind and not self.complete:
            self.problems.append(no_type(name))
            return
        if kind not in controller_types():
            what = f"unknown type '{kind}'" if kind else "no type"
            why = (
                broken_plugins().get(kind)
                or outdated(kind)
                or f"has {what}; known types are {', '.join(controller_types())}"
            )
            self.report(MANAGER, name, why)
            return
        if mistake := name_mistake(str(name)):
            self.report(MANAGER, name, mistake)
            return
        own = {key: value for key, value in parameters.items() if key not in SETTINGS}
        impossible = list(ros_mistakes(own))
        for key, text in impossible:
            self.report(name, key, text)
        checked = None if impossible else self.checked(name, controller_types()[kind].parameters_type, own)
        if checked is None:
            return
        if missing := checked.missing():
            text = "%s is loaded without its required parameters %s: set them on its node before you configure it"
            LOG.info(text, name, ", ".join(missing))
        else:
            self._check_use(name, checked)
        if name in settings.fallback and not self.complete:  # In the controllers file, ``controllers`` checks this.
            self.report(
                name, "fallback_controllers", f"names {name} itself: name another controller or remove the entry"
            )
        yield ControllerSpec(name, kind, checked, settings.fallback, with_ros_flag(settings.node_arguments))

    def _check_use(self, name: str, parameters: Parameters) -> None:
        for key, text in claim_mistakes(parameters, self.component):
            self.report(name, key, text)
        if unused := parameters.unused():
            LOG.warning("%s: %s: parameters without effect: %s", self.file.path, name, ", ".join(unused))

    @staticmethod
    def _not_in_file(name: str, others: Any, known: Sequence[str]) -> list[str]:
        """Return the entries of a list that name the controller itself or a controller that is not in the file."""
        listed = others if isinstance(others, list | tuple) else ()
        return [other for other in listed if other == name or other not in known]


def claim_mistakes(parameters: Parameters, component: HardwareInfo) -> Iterator[tuple[str, str]]:
    """Check that the URDF has each claimed command interface and that each is claimed once.

    Yields the name of the wrong parameter and a description of the mistake.
    """
    joints, claims = component.joints, parameters.claims()
    key = "joint" if "joint" in type(parameters).model_fields else "joints"
    block = "the URDF's <ros2_control> block"
    for claim in dict.fromkeys(claims):
        joint = Interface.parse(claim).joint
        if claim in component.outputs:
            continue
        if joint not in joints:
            yield key, f"names {joint}, which has no command_interface in {block} (joints there: {', '.join(joints)})"
        elif claim not in component.commands:
            yield key, f"needs {claim}, which is not a command_interface in {block}"
    for claim in sorted({claim for claim in claims if claims.count(claim) > 1}):
        yield key, f"names {Interface.parse(claim).joint} twice"
