"""Check the folder of an arm and report all errors together."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from commissioning.calibrate.plan import AUTO_PARTS
from controller.manager.controllers_file import ControllersFile, load_controllers_file
from controller.manager.parameter_file import read_parameter_file
from controller.manager_errors import ControllersFileError
from drivers.paths import resolved
from drivers.servos.catalog import MODELS
from hal.hal_errors import ArmFileError, DescriptionError, RobotFileError
from hal.robot_description.description import Description, HardwareInfo, merged
from hal.robot_description.description_check import description_problems, servo_problems
from hal.robot_description.link_meshes import PLACES, link_meshes, read_stl
from hal.robot_file.calibration_file import calibration_path, load_calibration
from hal.robot_file.robot import Robot, assemble
from hal.robot_file.robot_file import RobotFile, load_robot_file, unprotected
from hal.yaml_nodes import compose
from servoloop.extras import missing_extras
from servoloop.stack.arm_folders import ArmFile, ArmFolder, read_arm
from servoloop.stack.hardware import choose
from servoloop.stack.pick_place import PickPlace, load_pick_places
from servoloop.stack.pick_place_check import controller_problems, load_problems, pose_problems, ready_problems
from servoloop.stack.robot_files import read_description
from servoloop.stack.shipped_files import ARM_FILE

INTERFACES: Final = ("position", "velocity", "effort")


class _Check:
    """Check of one folder. All files are checked, even if some of them have errors.

    The scene and the pick-place parameters may be missing, because real arms do not need them. The scene is checked
    only if the extra ``sim`` is installed.
    """

    def __init__(self, arm: ArmFolder, names_known: bool = True) -> None:
        """``names_known`` states whether ``arm.yaml`` was readable.

        If ``arm.yaml`` was not readable, a file that seems to be missing may have another name.
        """
        self.problems: list[str] = []
        self._arm = arm
        self._names_known = names_known
        self._has_mujoco = not scene_unchecked()

    def run(self) -> list[str]:
        """Check all files and return the problems."""
        description = self._description()
        robot_file = self._robot_file()
        pick_places = self._pick_places()
        self._report(self._arm.robot, unprotected(robot_file) if robot_file else [])
        if robot_file:
            self._report(calibration_path(self._arm.robot), _seam_problems(self._arm.robot, robot_file))
        component = merged(description.components) if description else _component_of(robot_file)
        if component and self._names_known:
            self._report(self._arm.folder / ARM_FILE, _plan_problems(self._arm, component))
        controllers = self._controllers(robot_file, component)
        if description is None or component is None:
            self._scene(None, ())
            return self.problems
        self._report(self._arm.urdf, description_problems(description))
        self._report(self._arm.urdf, _plugin_problems(description))
        self._scene(description.xml, component.joints)
        self._meshes(description)
        robot = self._robot(robot_file, description, component) if robot_file else None
        if robot:
            self._report(self._arm.urdf, servo_problems(robot.joints))
        for pick_place in pick_places:
            self._check_pick_place(pick_place, description, controllers, robot)
        return self.problems

    def _check_pick_place(
        self, pick_place: PickPlace, description: Description, controllers: ControllersFile | None, robot: Robot | None
    ) -> None:
        self._report(self._arm.pick_place, pose_problems(pick_place, description))
        if self._has_mujoco:
            self._report(self._arm.pick_place, ready_problems(pick_place, self._arm.scene))
        if controllers:
            self._report(self._arm.pick_place, controller_problems(pick_place, controllers, description))
        if robot:
            try:
                self._report(self._arm.pick_place, load_problems(pick_place, robot, description))
            except DescriptionError as error:  # invalid masses
                self._report(self._arm.urdf, [str(error)])

    def _scene(self, urdf_xml: str | None, driven: Sequence[str]) -> None:
        """Compare the scene with the URDF; if the URDF is unreadable, only read the scene."""
        path, cell = self._arm.scene, self._arm.pick_place.exists()
        if not self._has_mujoco or (not self._wanted("scene") and not cell):
            return
        from sim_backend.scene.scene_check import scene_problems
        from sim_backend.scene.scene_file import scene_model

        if urdf_xml is not None:
            self._report(path, scene_problems(path, urdf_xml, driven, cell))
            return
        try:
            scene_model(path)
        except ArmFileError as error:
            self._failed(error)

    def _wanted(self, name: str) -> bool:
        """Return whether an optional file must be read. The file is read if it exists or if ``arm.yaml`` lists it."""
        return self._exists(name) or name in self._arm.file.model_fields_set

    def _exists(self, name: str) -> bool:
        path: Path = getattr(self._arm, name)
        return path.exists()

    def _needed(self, name: str) -> bool:
        """Return whether a required file must be read.

        If the name of the file is unknown, a file with the default name must exist.
        """
        return self._names_known or self._exists(name)

    def _report(self, path: Path, problems: Iterable[str]) -> None:
        self.problems += [p if p.startswith(str(path)) else f"{path}: {p}" for p in problems]

    def _description(self) -> Description | None:
        if not self._needed("urdf"):
            return None
        try:
            return read_description(self._arm.urdf)
        except DescriptionError as error:
            self._failed(error)
            return None

    def _robot_file(self) -> RobotFile | None:
        if not self._needed("robot"):
            return None
        try:
            return load_robot_file(self._arm.robot)
        except RobotFileError as error:
            self._failed(error)
            return None

    def _meshes(self, description: Description) -> None:
        folder = self._arm.scene.parent
        try:
            meshes = link_meshes(folder)
        except ArmFileError as error:
            self._failed(error)
            return
        links = dict.fromkeys(mesh.link for mesh in meshes if mesh.link not in description.links)
        self._report(folder / PLACES, (f"the URDF has no link {link}: correct the name of the link" for link in links))
        for path in dict.fromkeys(mesh.path for mesh in meshes):
            try:
                read_stl(path)
            except ArmFileError as error:
                self._failed(error)

    def _pick_places(self) -> list[PickPlace]:
        if not self._wanted("pick_place"):
            return []
        try:
            return list(load_pick_places(self._arm.pick_place).values())
        except ArmFileError as error:
            self._failed(error)
            return []

    def _robot(self, file: RobotFile, description: Description, component: HardwareInfo) -> Robot | None:
        try:
            return assemble(file, description, component)
        except RobotFileError as error:
            self._report(self._arm.robot, str(error).splitlines())
            return None

    def _controllers(self, file: RobotFile | None, component: HardwareInfo | None) -> ControllersFile | None:
        if not self._needed("controllers"):
            return None
        try:
            path = self._arm.controllers
            origin = compose(self._arm.robot, RobotFileError) if file else None
            defaults = file.controller_defaults if file else {}
            return load_controllers_file(path, defaults, component or _named_component(path), origin)
        except ControllersFileError as error:
            self._failed(error)
            return None

    def _failed(self, error: Exception) -> None:
        self.problems += str(error).splitlines()


def _plan_problems(arm: ArmFolder, component: HardwareInfo) -> Iterator[str]:
    """Yield a problem for each joint that lacks a calibration entry, and for each calibration entry that lacks a
    servo."""
    plan, file = arm.file.calibration, compose(arm.folder / ARM_FILE, ArmFileError)
    place = file.place(("calibration", "joints"))
    yield from (f"{place}: calibration has no entry for {name}" for name in component.joints if name not in plan.joints)
    named: dict[tuple[str, ...], Iterable[str]] = {("joints",): plan.joints}
    named |= {("auto", part): getattr(plan.auto, part) for part in AUTO_PARTS}
    strangers = {name: (*part, name) for part, names in named.items() for name in names if name not in component.joints}
    for name, location in sorted(strangers.items()):
        yield f"{file.place(('calibration', *location))}: calibration lists {name}, which has no servo"


def _seam_problems(robot: Path, file: RobotFile) -> Iterator[str]:
    """Yield a problem for each joint whose calibrated travel crosses the seam of its encoder."""
    calibration = load_calibration(robot)
    if calibration is None:
        return
    source = compose(calibration_path(robot), RobotFileError)
    for name, found in calibration.joints.items():
        last = MODELS[file.joints[name].model].last_count
        if found.crosses_seam(last):
            yield (
                f"{source.place(('joints', name))}: the travel of {name}, {found.lower_counts} to "
                f"{found.upper_counts}, is not within the counts 0 to {last} of its servo: calibrate the joint again"
            )


def _plugin_problems(description: Description) -> Iterator[str]:
    """Yield a problem for each component whose plugin is neither built in nor installed."""
    for component in description.components:
        try:
            choose(None, component)
        except DescriptionError as error:
            yield str(error)


def _component_of(robot_file: RobotFile | None) -> HardwareInfo | None:
    """Return the joints of the robot file as a substitute for an unreadable URDF, or None if there is no robot file."""
    return None if robot_file is None else _component(robot_file.joints, ("position",))


def _named_component(controllers: Path) -> HardwareInfo:
    """Return the joints listed by the controllers, for use if neither the URDF nor the robot file is readable."""
    _, content = read_parameter_file(controllers, ControllersFileError)
    return _component(dict.fromkeys(_joint_names(content)), INTERFACES)


def _component(joints: Iterable[str], commands: tuple[str, ...]) -> HardwareInfo:
    names = list(joints)
    return HardwareInfo("", "system", "", {}, dict.fromkeys(names, commands), dict.fromkeys(names, INTERFACES))


def _joint_names(content: Any) -> Iterator[str]:
    """Yield the entries of all lists with the key ``joints``."""
    for key, value in content.items() if isinstance(content, Mapping) else ():
        if key == "joints" and isinstance(value, list):
            yield from map(str, value)
        else:
            yield from _joint_names(value)


def scene_unchecked() -> str:
    """Return a sentence if scenes cannot be checked because the extra ``sim`` is missing; otherwise, return an empty
    string."""
    return missing_extras("the check of the scene", "sim")


def check_arm(folder: Path) -> list[str]:
    """Return all problems found in the folder of an arm.

    If ``arm.yaml`` has errors, the other files are checked under their default names.
    """
    try:
        return _Check(read_arm(folder)).run()
    except ArmFileError as error:
        home = resolved(folder)
        without = ArmFolder(home.name, home, ArmFile(description=home.name))
        return [*str(error).splitlines(), *_Check(without, names_known=False).run()]


def missing_parts(arm: ArmFolder) -> list[str]:
    """Return a sentence for each missing optional file, with the commands that need the file."""
    parts = {
        "scene": "emulate and up without --port need a scene: write a scene with `servoloop arms new`",
        "pick_place": "pick, demo and simulated jobs need pick-place parameters: docs/arms/README.md describes them",
    }
    paths = {name: getattr(arm, name) for name in parts}
    return [f"no {path.name}: {parts[name]}" for name, path in paths.items() if not path.exists()]
