"""Whether an arm's folder is right: all that is wrong with it, at once."""

from collections.abc import Iterable, Iterator
from pathlib import Path

from controller.manager.controllers_file import ControllersFile, ControllersFileError, load_controllers_file
from hal.errors import ArmFileError, DescriptionError, RobotFileError
from hal.robot_description.description import Description, HardwareInfo, merged
from hal.robot_description.description_check import description_problems, servo_problems
from hal.robot_description.link_meshes import PLACES, link_meshes, read_stl
from hal.robot_file.robot import Robot, assemble
from hal.robot_file.robot_file import RobotFile, load_robot_file, unprotected
from servoloop.arms.folder import ARM_FILE, Arm, read_arm
from servoloop.arms.pick_place import PickPlace, load_pick_place
from servoloop.arms.pick_place_check import controller_problems, load_problems, pose_problems, ready_problems
from servoloop.files import read_description
from sim_backend.scene.scene_check import scene_problems


class _Check:
    """One folder being looked at. Every file is read, whatever is wrong with the others."""

    def __init__(self, arm: Arm) -> None:
        self.problems: list[str] = []
        self._arm = arm

    def run(self) -> list[str]:
        """Look at everything."""
        description = self._description()
        robot_file = self._robot_file()
        pick_place = self._pick_place()
        if description is None:
            return self.problems
        component = merged(description.components)
        self._say(self._arm.urdf, description_problems(description))
        self._say(self._arm.scene, scene_problems(self._arm.scene, description.xml, component.joints))
        self._meshes(description)
        self._say(self._arm.folder / ARM_FILE, _plan_problems(self._arm, component))
        self._say(self._arm.robot, unprotected(robot_file) if robot_file else [])
        robot = self._robot(robot_file, description, component) if robot_file else None
        controllers = self._controllers(robot_file, component) if robot_file else None
        if robot:
            self._say(self._arm.urdf, servo_problems(robot.joints))
        if pick_place:
            self._say(self._arm.pick_place, pose_problems(pick_place, description))
            self._say(self._arm.pick_place, ready_problems(pick_place, self._arm.scene))
        if pick_place and controllers:
            self._say(self._arm.pick_place, controller_problems(pick_place, controllers, description))
        if pick_place and robot:
            try:
                self._say(self._arm.pick_place, load_problems(pick_place, robot, description))
            except DescriptionError as error:  # masses that make no sense
                self._say(self._arm.urdf, [str(error)])
        return self.problems

    def _say(self, path: Path, problems: Iterable[str]) -> None:
        self.problems += [f"{path}: {problem}" for problem in problems]

    def _description(self) -> Description | None:
        try:
            return read_description(self._arm.urdf)
        except DescriptionError as error:
            self._failed(error)
            return None

    def _robot_file(self) -> RobotFile | None:
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
        self._say(folder / PLACES, (f"the URDF has no link {link}: correct its name" for link in links))
        for path in dict.fromkeys(mesh.path for mesh in meshes):
            try:
                read_stl(path)
            except ArmFileError as error:
                self._failed(error)

    def _pick_place(self) -> PickPlace | None:
        try:
            return load_pick_place(self._arm.pick_place)
        except ArmFileError as error:
            self._failed(error)
            return None

    def _robot(self, file: RobotFile, description: Description, component: HardwareInfo) -> Robot | None:
        try:
            return assemble(file, description, component)
        except RobotFileError as error:
            self._say(self._arm.robot, str(error).splitlines())
            return None

    def _controllers(self, file: RobotFile, component: HardwareInfo) -> ControllersFile | None:
        try:
            return load_controllers_file(self._arm.controllers, file.controller_defaults, component)
        except ControllersFileError as error:
            self._failed(error)
            return None

    def _failed(self, error: Exception) -> None:
        self.problems += str(error).splitlines()


def _plan_problems(arm: Arm, component: HardwareInfo) -> Iterator[str]:
    """Yields joints whose calibration nobody has described, and descriptions of none of the arm's joints."""
    plan = arm.file.calibration
    named = {*plan.joints, *plan.auto.start, *plan.auto.clear, *plan.auto.stops, *plan.auto.drive}
    yield from (f"calibration says nothing of {name}" for name in component.joints if name not in plan.joints)
    yield from (f"calibration names {name}, which has no servo" for name in sorted(named - set(component.joints)))


def check_arm(folder: Path) -> list[str]:
    """All that is wrong with the arm in a folder; nothing where it is right."""
    try:
        arm = read_arm(folder)
    except ArmFileError as error:
        return str(error).splitlines()
    return _Check(arm).run()
