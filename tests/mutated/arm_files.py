"""Files of an arm: robot description, robot file, controllers, pick-and-place, scene and arm.yaml."""

from collections.abc import Callable
from itertools import chain
from pathlib import Path
from typing import Final

import numpy as np

from controller.interface import ControllerContext
from controller.loop import ControlLoop
from controller.manager.factory import Factory
from controller.manager.manager import ControllerManager
from controller.manager.settings import ManagerSettings
from drivers.clock import MonotonicClock
from hal.hal_errors import ArmFileError
from servoloop.dashboard.arm_model import DrawnArm
from servoloop.dashboard.shapes import scene_shapes, shapes, thing_shapes
from servoloop.moveit.surroundings import surroundings
from servoloop.stack.arm_folders import arms, find_arm, read_arm_files, read_arm_servos
from servoloop.stack.hardware import build, compensation
from servoloop.stack.pick_place import load_pick_place
from servoloop.stack.robot_check import check_arm
from servoloop.stack.robot_files import Files, initial_states
from servoloop.stack.shipped_files import ARMS, CONFIG, OWN
from servoloop.stack.virtual_lines import VirtualLines
from sim_backend.buses.build import Build
from sim_backend.scene.scene_check import require_scene, scene_problems
from sim_backend.scene.world import World
from tests.mutated.kind import SO101, Kind, files_of, of_paths


def come_up(files: Files) -> None:
    """Process the files as ``servoloop up`` and ``servoloop emulate`` do before they open a port."""
    initial_states(files)
    devices = {name: f"/dev/none{name}" for name in files.robot.file.lines()}
    clock = MonotonicClock()
    setup = build(None, files, devices, clock)
    manager = ControllerManager(setup.hardware, files.limits)
    context = ControllerContext(files.description, files.component, files.limits, lambda: True, setup.compliances)
    Factory(files.controllers, context).fill(manager)
    ControlLoop(setup.hardware, manager, files.limits, clock, 1.0 / files.controllers.update_rate_hz)
    VirtualLines(files, Build())
    compensation(files.robot.joints, files.description)


def read_robot(arm: str) -> Callable[[Path], None]:
    return lambda path: come_up(read_arm_files(find_arm(arm), robot=path))


def read_urdf(arm: str) -> Callable[[Path], None]:
    def read(path: Path) -> None:
        own = find_arm(arm)
        files = read_arm_files(own, urdf=path, robot=own.robot)
        scene_problems(own.scene, files.description.xml, files.component.joints)
        drawn(files, path)
        come_up(files)

    return read


def drawn(files: Files, urdf: Path) -> None:
    """Read a robot description as the page of ``servoloop view`` does."""
    shapes(files.description.xml, urdf.parent)
    model = DrawnArm(dict(files.description.joints), files.component.joints)
    list(model.fixed())
    list(model.moving(np.zeros(len(files.component.joints))))
    for link in model.links:
        model.branch(link)
        model.joint_of(link)


def read_controllers(path: Path) -> None:
    come_up(read_arm_files(find_arm(), controllers=path))


def read_parameters(path: Path) -> None:
    """Read the parameters of one controller, as the spawner and ``params_file`` do."""
    files = files_of(OWN)
    context = ControllerContext(files.description, files.component, files.limits, lambda: True, {})
    kinds = {spec.name: spec.kind for spec in files.controllers.controllers}
    for name in ("arm_controller", "hand_controller"):
        Factory(files.controllers, context).spec(name, ManagerSettings(kinds[name], (path,)))


def read_pick_place(path: Path) -> None:
    load_pick_place(path).settings()


def read_scene(arm: str) -> Callable[[Path], None]:
    def read(path: Path) -> None:
        files = read_arm_servos(find_arm(arm))
        scene_problems(path, files.description.xml, files.component.joints)
        require_scene(path, files.component.joints)
        World(path, backlash=dict.fromkeys(files.component.joints, 0.01))
        list(chain(scene_shapes(path), thing_shapes(path)))
        surroundings(path, 0.01, [])

    return read


def beside_arm(folder: Path) -> None:
    """Write the other files of an arm."""
    for path in find_arm(SO101).folder.iterdir():
        if path.is_file():
            (folder / path.name).write_bytes(path.read_bytes())


def read_arm_folder(path: Path) -> None:
    """Raise an error with the problems that ``servoloop arms check`` would print."""
    if problems := check_arm(path.parent):
        raise ArmFileError("\n".join(problems))


def _each(kind: str, name: str, read: Callable[[str], Callable[[Path], None]]) -> dict[str, Kind]:
    """Return a kind of file for each arm that has its own file. ``read`` returns the reader for an arm, given its
    name."""
    paths = {getattr(arm, kind): arm.name for arm in reversed(arms())}
    return {f"{kind} of {arm}": Kind(name, of_paths(path), read(arm)) for path, arm in paths.items()}


TWO_BUSES: Final = CONFIG / "robot_arm_two_buses.yaml"
CONTROLLERS: Final = CONFIG / "arm_controllers.yaml"
KINDS: Final = {
    **_each("robot", "robot.yaml", read_robot),
    "robot with two buses": Kind("robot.yaml", of_paths(TWO_BUSES), read_robot(OWN)),
    **_each("urdf", "arm.urdf", read_urdf),
    "controllers": Kind("controllers.yaml", of_paths(CONTROLLERS), read_controllers),
    "controller's parameters": Kind("more.yaml", of_paths(CONTROLLERS), read_parameters),
    "pick-place": Kind("pick_place.yaml", of_paths(*sorted({arm.pick_place for arm in arms()})), read_pick_place),
    **_each("scene", "scene.xml", read_scene),
    "arm": Kind("arm.yaml", of_paths(ARMS / SO101 / "arm.yaml"), read_arm_folder, beside_arm),
}
