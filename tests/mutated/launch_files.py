"""Files of the folder that ``servoloop arms moveit`` writes, as read by the launch file for MoveIt."""

import sys
from pathlib import Path
from shutil import copytree
from types import ModuleType
from typing import Final
from unittest.mock import patch

from hal.hal_errors import ArmFileError
from servoloop.stack.shipped_files import CONFIG, HOME
from tests.launch.reading import MOVEIT, actions
from tests.launch.recorders import modules
from tests.mutated.kind import Kind, of_paths

FILES: Final = CONFIG / "moveit"
NAMES: Final = ("kinematics.yaml", "joint_limits.yaml", "planning_scene.yaml", "robot_arm.srdf")


def beside(folder: Path) -> None:
    copytree(FILES, folder, dirs_exist_ok=True)


def read(path: Path) -> None:
    index = ModuleType("ament_index_python.packages")
    vars(index)["get_package_share_directory"] = lambda name: str(HOME)
    with patch.dict(sys.modules, {**modules(), index.__name__: index}):
        try:
            actions(HOME / "launch" / MOVEIT, moveit=str(path.parent), hardware="mock")
        except Exception as error:
            if type(error).__name__ != "FileError":  # a class of the launch file, which cannot be imported
                raise
            raise ArmFileError(str(error)) from error


KINDS: Final = {f"launch: {name}": Kind(name, of_paths(FILES / name), read, beside) for name in NAMES}
