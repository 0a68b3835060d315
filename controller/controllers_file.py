"""The controllers file, in ros2_control's own format: read whole, and every mistake told with its line."""

import logging
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel, RootModel, ValidationError

from controller.kinds import kinds
from controller.parameters import ManagerParameters, Parameters
from hal.description import Component
from hal.yaml_file import load, place

LOG = logging.getLogger("servoloop.controller")

MANAGER = "controller_manager"


class ControllersFileError(Exception):
    """The controllers file has mistakes; the text lists them with file and line."""


class _Node(BaseModel):
    ros__parameters: dict[str, Any] = {}


class _File(RootModel[dict[str, _Node]]):
    pass


@dataclass(frozen=True, slots=True)
class ControllerFile:
    """One controller: its name, type and checked parameters."""

    name: str
    kind: str
    parameters: Parameters


@dataclass(frozen=True, slots=True)
class ControllersFile:
    """The whole file, checked."""

    path: Path
    update_rate_hz: int
    controllers: tuple[ControllerFile, ...]


def load_controllers_file(
    path: Path, defaults: Mapping[str, Mapping[str, Any]], component: Component
) -> ControllersFile:
    """Read and check the file; ``defaults`` by controller fill in what it does not say.

    Raises ControllersFileError with every mistake.
    """
    nodes = load(path, _File, ControllersFileError).root
    if MANAGER not in nodes:
        raise ControllersFileError(f"{path} has no {MANAGER}")
    reader = _Reader(path, {name: node.ros__parameters for name, node in nodes.items()}, [])
    controllers = reader.controllers(defaults)
    reader.problems += _unknown_joints(reader, controllers, component)
    reader.problems += _claimed_twice(reader, controllers)
    manager = reader.checked(MANAGER, ManagerParameters, nodes[MANAGER].ros__parameters)
    if reader.problems or not isinstance(manager, ManagerParameters):
        raise ControllersFileError("\n".join(reader.problems))
    return ControllersFile(path, manager.update_rate, tuple(controllers))


@dataclass(slots=True)
class _Reader:
    """One file being read: the parameters of each node, and the mistakes found so far."""

    path: Path
    nodes: Mapping[str, Mapping[str, Any]]
    problems: list[str]

    def say(self, node: str, key: str, text: str) -> str:
        """A mistake with file and line."""
        return f"{place(self.path, (node, 'ros__parameters', key))}: {node}.{key} {text}"

    def controllers(self, defaults: Mapping[str, Mapping[str, Any]]) -> list[ControllerFile]:
        """The controllers that the manager names and whose parameters are right."""
        found: list[ControllerFile] = []
        for name, entry in self.nodes[MANAGER].items():
            if isinstance(entry, dict):
                own = self.nodes.get(name, {})
                self.problems += self._bad_waits(name, own.get("wait_for"))
                found += self._controller(name, entry, {**defaults.get(name, {}), **own})
        if not found and not self.problems:
            self.problems.append(f"{place(self.path, (MANAGER,))}: {MANAGER} names no controllers")
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

    def _controller(
        self, name: str, entry: Mapping[str, Any], parameters: Mapping[str, Any]
    ) -> Iterator[ControllerFile]:
        kind = str(entry.get("type", ""))
        if kind not in kinds():
            what = f"unknown type '{kind}'" if kind else "no type"
            self.problems.append(self.say(MANAGER, name, f"has {what}, known types are {', '.join(kinds())}"))
            return
        checked = self.checked(name, kinds()[kind].parameters_type, parameters)
        if checked is None:
            return
        if unused := checked.unused():
            LOG.warning("%s: %s: not used: %s", self.path, name, ", ".join(unused))
        yield ControllerFile(name, kind, checked)

    def _bad_waits(self, name: str, waits: Any) -> list[str]:
        """Who waits for nobody does not wait. The robot file's defaults may name one that this file has not."""
        known = self.nodes[MANAGER]
        return [
            self.say(name, "wait_for", f"names {other}, which is no other controller of this file")
            for other in (waits if isinstance(waits, list) else [])
            if other == name or other not in known
        ]


def _unknown_joints(reader: _Reader, controllers: list[ControllerFile], component: Component) -> list[str]:
    known = component.joints
    text = "names {}, which takes no commands in the URDF's <ros2_control> block (it has {})"
    return [
        reader.say(c.name, "joints", text.format(joint, ", ".join(known)))
        for c in controllers
        for joint in _joints(c)
        if joint not in known
    ]


def _claimed_twice(reader: _Reader, controllers: list[ControllerFile]) -> list[str]:
    problems: list[str] = []
    owners: dict[str, str] = {}
    for c in controllers:
        joints = _joints(c)
        for joint in joints:
            other = owners.setdefault(joint, c.name)
            if other != c.name:
                text = f"clash: {other} and {c.name} both command {joint}: a joint belongs to one controller"
                problems.append(reader.say(c.name, "joints", text))
        twice = sorted({joint for joint in joints if joints.count(joint) > 1})
        problems += [reader.say(c.name, "joints", f"names {joint} twice") for joint in twice]
    return problems


def _joints(controller: ControllerFile) -> list[str]:
    """The joints that it commands."""
    return [claim.rpartition("/")[0] for claim in controller.parameters.claims()]
