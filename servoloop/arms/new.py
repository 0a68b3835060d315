"""Create the folder for a new arm: URDF, robot file, controllers file, ``arm.yaml`` and scene."""

import re
from pathlib import Path
from typing import Final

from commissioning.atomic_write import make_folder, write_file
from drivers.printable import printable_line
from drivers.servos.catalog import MODELS
from hal.hal_errors import ArmFileError
from servoloop.arms.new_files import arm_text, controllers_text, robot_text
from servoloop.arms.new_urdf import ROBOT_FILE, NewDescription, metres_per_radian, new_description
from servoloop.extras import missing_extras
from servoloop.stack.shipped_files import ARM_FILE, ARMS

NAME: Final = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


def new_arm(folder: Path, urdf: Path, servo: str) -> list[Path]:
    """Create the folder for a new arm. The folder name becomes the arm name.

    The scene is written only if the ``sim`` extra is installed. A real arm does not need a scene.

    Args:
        folder: New folder.
        urdf: Robot description, with or without a <ros2_control> block.
        servo: Model of all servos.

    Returns:
        Paths of the written files.

    Raises:
        ArmFileError: The name or the folder cannot be used, or none of the joints can be driven.
        DescriptionError: The URDF has errors.
    """
    name = folder.name
    if not NAME.fullmatch(name):
        raise ArmFileError(f"{name!r} cannot be the name of an arm: use letters, digits and _, starting with a letter")
    if (ARMS / name).is_dir():
        raise ArmFileError(f"servoloop already includes an arm {name}: choose another name")
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ArmFileError(f"{folder} already exists: choose another name, or remove it first")
    if servo not in MODELS:
        raise ArmFileError(f"unknown servo model {servo}: choose one of {', '.join(MODELS)}")
    model = MODELS[servo]
    made = new_description(urdf, folder, name, model)
    files = {
        ARM_FILE: arm_text(f"{name}, from {printable_line(urdf.name)}", made.joints),
        "arm.urdf": made.xml,
        ROBOT_FILE: robot_text(made, model),
        "controllers.yaml": controllers_text(made),
    }
    if not missing_extras("the scene", "sim"):
        files["scene.xml"] = _scene(made)
    make_folder(folder)
    for file, text in files.items():
        write_file(folder / file, text, keep=False)
    return [folder / file for file in files]


def _scene(made: NewDescription) -> str:
    from sim_backend.scene.plain_scene import plain_scene

    return plain_scene(made.xml, {joint.name: metres_per_radian(joint) or 1.0 for joint in made.joints})
