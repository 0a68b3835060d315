"""Read and check a controllers file in the format of ros2_control. Every error is reported with its line number."""

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from controller.manager.claims import claim_mistakes
from controller.manager.controller_spec import ControllerSpec, name_mistake, with_ros_flag
from controller.manager.node_parameters import files_in, merged, parameters_in
from controller.manager.parameter_file import MOST_NODES, PARAMETERS
from controller.manager.plugins import SUCCESSORS, broken_plugins, controller_types, outdated
from controller.manager.sections import MANAGER, Sections, SectionsWithDefaults
from controller.manager.settings import SETTINGS, ManagerSettings, setting_mistakes
from controller.manager_errors import ControllersFileError
from controller.parameters import ManagerParameters, Parameters, ros_mistakes
from hal.file_size import check_existing
from hal.robot_description.description import HardwareInfo
from hal.yaml_file import YamlPlaces, mistakes

LOG = logging.getLogger("servoloop.controller")

GROUPS = ("defaults", "diagnostics", "hardware_components_initial_state", "overruns", "qos_overrides")
"""Groups of manager parameters that look like controllers in the file."""
DEFAULTS = "controller_defaults"
"""Robot file key for default controller parameters."""
HONORED = ("hardware_components_initial_state", "qos_overrides", "robot_description", "use_sim_time")
"""Manager parameters that have an effect or that every node has."""
NOT_ANOTHER = "names {}, which is not another controller in this file: correct the name"
"""Message about an entry of ``wait_for`` or ``fallback_controllers``."""

Defaults = Mapping[str, Mapping[str, Any]]
"""Default parameter values, keyed by controller name and parameter name."""


@dataclass(frozen=True, slots=True)
class ControllersFile:
    """A checked controllers file. ``sections`` also contains the parameters of nodes that are not controllers."""

    sections: Sections
    update_rate_hz: int
    controllers: tuple[ControllerSpec, ...]
    defaults: Defaults = field(default_factory=dict)
    namespace: str = ""
    """Namespace of the nodes; empty for the root namespace."""

    @property
    def path(self) -> Path:
        """Path of the file."""
        return self.sections.file.path

    @property
    def manager(self) -> Mapping[str, Any]:
        """Parameters of the manager itself."""
        return self.parameters(MANAGER)

    def parameters(self, node: str) -> dict[str, Any]:
        """Return the parameters of a node of the stack."""
        return self.sections.of(node)


def load_controllers_file(
    path: Path, defaults: Defaults, component: HardwareInfo, origin: YamlPlaces | None = None, namespace: str = ""
) -> ControllersFile:
    """Read and check a controllers file.

    Args:
        path: Path of the file.
        defaults: Default parameter values, keyed by controller name.
        component: The joints and interfaces of the robot.
        origin: Robot file that provides the defaults.
        namespace: Namespace of the nodes; empty for the root namespace.

    Raises:
        ControllersFileError: The file has errors. The message lists all errors.
    """
    sections = _sections(path, namespace)
    places = sections if origin is None else SectionsWithDefaults(sections, origin, DEFAULTS, defaults)
    reader = _Reader(sections, component, [], places)
    controllers = reader.controllers(defaults, namespace)
    manager = reader.checked(MANAGER, ManagerParameters, sections.of(MANAGER))
    if reader.problems or not isinstance(manager, ManagerParameters):
        raise ControllersFileError("\n".join(reader.problems))
    reader.name_unused(manager)
    if not controllers:
        LOG.warning("%s: %s lists no controllers: load them with a spawner", path, MANAGER)
    return ControllersFile(sections, manager.update_rate, tuple(controllers), defaults, namespace)


def _sections(path: Path, namespace: str) -> Sections:
    """Read the sections of the nodes in a namespace. If the namespace does not contain a manager, read the sections of
    the root namespace.

    Raises ControllersFileError.
    """
    sections = Sections.read(path, namespace, ControllersFileError)
    for found in (sections, replace(sections, namespace="")):
        if found.has(MANAGER):
            return found
    name = f"{namespace}/{MANAGER}" if namespace else MANAGER
    others = [pattern for pattern in sections.content if pattern.rpartition("/")[2] == MANAGER]
    remedy = f"rename {others[0]} or use its namespace" if others else "add a section that lists the controllers"
    raise ControllersFileError(f"{path}:1: the file has no {name} section: {remedy}")


def load_controller(
    file: ControllersFile, name: str, settings: ManagerSettings, component: HardwareInfo
) -> ControllerSpec:
    """Build the spec of one controller. Required parameters may still be missing.

    Args:
        file: The robot's controllers file.
        name: Name of the controller.
        settings: Settings that override those in ``file``. The parameter files in these settings also override
            ``file``.
        component: The joints and interfaces of the robot.

    Raises:
        ControllersFileError: The parameters have errors. The message lists all errors.
        ValueError: A node argument is not valid YAML.
    """
    source = _Source(file.sections, file.defaults, file.namespace)
    settings = settings.over(ManagerSettings.of(source.entry(name)))
    last, parameters = source.parameters(name, settings)
    reader = _Reader(last, component, [], last, complete=False)
    found = list(reader.controller(name, settings, parameters))
    if reader.problems:
        raise ControllersFileError("\n".join(reader.problems))
    return found[0]


@dataclass(frozen=True, slots=True)
class _Source:
    """The controllers file and the robot file's defaults, before a controller's parameter files are merged in."""

    sections: Sections
    defaults: Defaults
    namespace: str
    """Namespace of the nodes; ``sections`` may still be those of the root namespace."""

    def entry(self, name: str) -> dict[str, Any]:
        """Return the settings of a controller. The manager's section overrides the controller's own section."""
        found: dict[str, Any] = {}
        for _, _, settings in self.settings(name):
            found |= settings
        return found

    def settings(self, name: str) -> Iterator[tuple[str, str, dict[str, Any]]]:
        """Yield the settings from the controller's own section, and then those from the manager's section.

        Each item contains the section's node, the prefix of the keys, and the settings.
        """
        own, entry = self.sections.of(name), self.sections.of(MANAGER).get(name)
        yield name, "", {key: own[key] for key in SETTINGS if key in own}
        yield MANAGER, f"{name}.", dict(entry) if isinstance(entry, Mapping) else {}

    def controllers(self) -> list[str]:
        """Return the names of controllers listed by the manager, and the names of sections with a controller type."""
        named = [n for n, entry in self.sections.of(MANAGER).items() if isinstance(entry, Mapping)]
        known = {*controller_types(), *SUCCESSORS}
        typed = [n for n in self.sections.nodes() if n not in named and self.sections.of(n).get("type") in known]
        return [name for name in dict.fromkeys([*named, *typed]) if name not in GROUPS]

    def parameters(self, name: str, settings: ManagerSettings) -> tuple[Sections, dict[str, Any]]:
        """Return the sections with the highest priority and the controller's merged parameters.

        Raises ControllersFileError or ValueError.
        """
        node = f"{self.namespace}/{name}" if self.namespace else name
        given, paths = parameters_in(settings.node_arguments, node), settings.files
        for path in files_in(settings.node_arguments):
            check_existing(path, ControllersFileError)
        files = [Sections.read(path, self.namespace, ControllersFileError) for path in paths]
        if paths and not any(file.concerns(name) for file in files):
            listed = ", ".join(map(str, paths))
            raise ControllersFileError(f"{listed} has no section for {node}: add '{node}: ros__parameters: …'")
        found = merged(self.defaults.get(name, {}), self.sections.of(name))
        for parameters in (*(file.of(name) for file in files), given):
            found = merged(found, parameters)
        return files[-1] if files else self.sections, found


def no_type(name: str) -> str:
    """Return the error message for a controller without a type. The message starts with ros2_control's own message."""
    return (
        f"The 'type' param was not defined for '{name}': set {name}.type on the node {MANAGER}, "
        "or give the controller a section with its type in a parameter file"
    )


@dataclass(slots=True)
class _Reader:
    """Reader for the sections of one file, with the errors found so far."""

    sections: Sections
    component: HardwareInfo
    problems: list[str]
    places: YamlPlaces
    complete: bool = True
    """Whether a missing required parameter is an error."""

    def report(self, node: str, key: str, text: str) -> None:
        """Record an error of a parameter, or of the node itself if the key is empty, with its file and line."""
        keys = key.split(".") if key else []
        self.problems.append(f"{self.places.place((node, PARAMETERS, *keys))}: {'.'.join([node, *keys])} {text}")

    def controllers(self, defaults: Defaults, namespace: str) -> list[ControllerSpec]:
        """Return the specs of all controllers whose parameters are valid."""
        source = _Source(self.sections, defaults, namespace)
        known = source.controllers()
        if len(known) > MOST_NODES:
            place = self.sections.place((MANAGER, PARAMETERS, known[MOST_NODES]))
            raise ControllersFileError(f"{place}: {MANAGER} has more than {MOST_NODES} controllers: remove some")
        found: list[ControllerSpec] = []
        for name in known:
            if self.sections.elsewhere(name):
                self._report_elsewhere(name)
                continue
            entry = source.entry(name)
            waits = self.sections.of(name).get("wait_for")
            for other in self._not_in_file(name, waits, known):
                self.report(name, "wait_for", NOT_ANOTHER.format(other))
            if self._settings_wrong(source, name):
                continue
            settings = ManagerSettings.of(entry)
            for other in self._not_in_file(name, settings.fallback, known):
                self.report(MANAGER, f"{name}.fallback_controllers", NOT_ANOTHER.format(other))
            try:
                last, parameters = source.parameters(name, settings)
            except (ControllersFileError, ValueError) as error:
                self.report(MANAGER, name, f"cannot be loaded: {error}")
                continue
            places = self.places if last is self.sections else last
            reader = _Reader(last, self.component, self.problems, places)
            found += reader.controller(name, settings, parameters)
        return found

    def _report_elsewhere(self, name: str) -> None:
        namespace = self.sections.namespace
        self.problems.append(
            f"{self.sections.place((name,))}: this section is for /{name}, but the controller is {namespace}/{name}: "
            f"name the section {namespace}/{name} or /**/{name}"
        )

    def _settings_wrong(self, source: _Source, name: str) -> bool:
        """Record the errors in the settings of a controller. Return whether there are errors."""
        known = len(self.problems)
        for node, prefix, settings in source.settings(name):
            for key, text in setting_mistakes(settings):
                self.report(node, f"{prefix}{key}", text)
        return len(self.problems) > known

    def name_unused(self, manager: ManagerParameters) -> None:
        """Log the manager parameters that do not have any effect."""
        extra = manager.model_extra or {}
        unused = [key for key in manager.unused() if key in GROUPS or not isinstance(extra[key], Mapping)]
        unused += [
            f"{name}.{key}"
            for name, entry in extra.items()
            if name not in GROUPS and isinstance(entry, Mapping)
            for key in entry
            if key not in SETTINGS
        ]
        self._log_unused(MANAGER, [key for key in unused if key not in HONORED])
        if not manager.enforce_command_limits:
            LOG.warning(
                "%s: %s: enforce_command_limits: false has no effect, because the limits of the URDF always apply",
                *(self.sections.file.path, MANAGER),
            )

    def checked(self, name: str, model: type[Parameters], parameters: Mapping[str, Any]) -> Parameters | None:
        """Return the parameters as an instance of ``model``. If the parameters are invalid, record each error and
        return None."""
        try:
            return model.model_validate(dict(parameters)) if self.complete else model.as_far_as_given(parameters)
        except ValidationError as error:
            self.problems += mistakes(self.places, error, (name, PARAMETERS), name)
            if not self.sections.has(name):
                self._report_similar(
                    name, [str(item["loc"][0]) for item in error.errors() if item["type"] == "missing"]
                )
            return None

    def _report_similar(self, name: str, missing: Sequence[str]) -> None:
        """Record the sections that set a missing parameter, but whose node is not a controller."""
        listed = self.sections.of(MANAGER)
        for other in self.sections.nodes():
            if other not in listed and self.sections.of(other).keys() & set(missing):
                place = self.sections.place((other,))
                self.problems.append(f"{place}: the section {other} is not used: rename the section to {name}")

    def controller(
        self, name: str, settings: ManagerSettings, parameters: Mapping[str, Any]
    ) -> Iterator[ControllerSpec]:
        """Yield the spec of a controller, unless it has errors."""
        kind = settings.kind
        if kind in SUCCESSORS and self.complete:
            LOG.error("%s: %s is not loaded: %s", self.sections.file.path, name, outdated(kind))
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
        mistake = name_mistake(str(name))
        if name in self.component.node_names:
            mistake = "is also the name of a <ros2_control> block, whose node has the same name: rename one of them"
        if mistake:
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
        if name in settings.fallback and not self.complete:  # For the controllers file, ``controllers`` checks this.
            self.report(
                name, "fallback_controllers", f"names {name} itself: name another controller or remove the entry"
            )
        yield ControllerSpec(name, kind, checked, settings.fallback, with_ros_flag(settings.node_arguments))

    def _check_use(self, name: str, parameters: Parameters) -> None:
        for key, text in claim_mistakes(parameters, self.component):
            self.report(name, key, text)
        self._log_unused(name, parameters.unused())

    def _log_unused(self, node: str, unused: Sequence[str]) -> None:
        for text in unused:
            key = text.partition(" ")[0].removesuffix(":")
            place = self.places.place((node, PARAMETERS, *key.split(".")))
            LOG.warning("%s: %s: parameter without effect: %s", place, node, text)

    @staticmethod
    def _not_in_file(name: str, others: Any, known: Sequence[str]) -> list[str]:
        """Return the list entries that name the controller itself or a controller that is not in the file."""
        listed = others if isinstance(others, list | tuple) else ()
        return [other for other in listed if other == name or other not in known]
