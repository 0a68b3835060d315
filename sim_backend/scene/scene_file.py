"""The file of a scene, read by MuJoCo: a missing or a broken one is refused with a sentence."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco

from hal.errors import ArmFileError


def scene_spec(scene: Path) -> Any:
    """The editable model of a scene. Raises ArmFileError."""
    return _read(scene, mujoco.MjSpec.from_file)


def scene_model(scene: Path) -> Any:
    """The compiled model of a scene. Raises ArmFileError."""
    return _read(scene, mujoco.MjModel.from_xml_path)


def _read(scene: Path, read: Callable[[str], Any]) -> Any:
    if not scene.exists():
        raise ArmFileError(
            f"{scene} is missing, and without a scene the arm has no virtual servos: `servoloop arms new NAME "
            "robot.urdf` writes a scene for any URDF; a real arm, with --port, needs none"
        )
    try:
        return read(str(scene))
    except ValueError as error:
        raise ArmFileError(f"{scene}: MuJoCo cannot read it: {' '.join(str(error).split())}") from error
