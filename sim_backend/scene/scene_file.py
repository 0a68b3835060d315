"""Read scenes, which are MuJoCo files written by users. Check the limits, and report errors with line numbers."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final
from xml.etree.ElementTree import Element

import mujoco

from hal.hal_errors import ArmFileError
from hal.robot_description.xml_places import place
from sim_backend.scene.scene_parts import scene_parts

LARGEST: Final = 1e10
"""MuJoCo's own limit for positions, velocities and forces. If a value exceeds this limit, MuJoCo resets the
simulation."""
MOST_COPIES: Final = 10_000
"""Maximum ``count`` of a <replicate>, <composite> or <flexcomp>."""


def scene_model(path: Path) -> Any:
    """Return the compiled model of a scene. Raises ArmFileError with a list of all errors."""
    _check(path)
    try:
        return mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise _refused(path, error) from error


def scene_spec(path: Path) -> Any:
    """Return the specification of a scene, which can be changed before the scene is compiled. Raises ArmFileError."""
    _check(path)
    try:
        return mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise _refused(path, error) from error


def _refused(path: Path, error: ValueError) -> ArmFileError:
    text = " ".join(str(error).replace(" number=", " ").split())
    return ArmFileError(f"{path}: MuJoCo cannot read the scene: {text}")


def _check(path: Path) -> None:
    """Check the size, encoding and numbers of a scene and of all files that the scene refers to. Raises
    ArmFileError."""
    if not path.exists():
        raise ArmFileError(
            f"{path} is missing, and without a scene the arm has no virtual servos. `servoloop arms new NAME "
            "robot.urdf` writes a scene for any URDF. A real arm, selected with --port, needs no scene"
        )
    if not _is_utf8(path):
        raise ArmFileError(
            f"{path}: MuJoCo cannot open this path, because it is not valid UTF-8: rename the file or its folder"
        )
    elements = (element for root in scene_parts(path) for element in root.iter())
    if mistakes := [mistake for element in elements for mistake in _mistakes(element)]:
        raise ArmFileError("\n".join(mistakes[:50]))


def _is_utf8(path: Path) -> bool:
    """Return whether the path, as MuJoCo receives it, can be encoded as UTF-8."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return False
    return True


def _mistakes(element: Element) -> Iterator[str]:
    for key, text in element.attrib.items():
        numbers = list(_numbers(text))
        if not all(abs(number) <= LARGEST for number in numbers):  # also false for NaN
            yield f'{place(element)}: {element.tag} {key} must consist of numbers up to {LARGEST:g}, not "{text[:50]}"'
        if key == "count" and math.prod(numbers) > MOST_COPIES:
            yield f"{place(element)}: {element.tag} makes more than {MOST_COPIES} copies: reduce its count"


def _numbers(text: str) -> Iterator[float]:
    """Yield the numbers of an attribute. Words that are not numbers are ignored."""
    for part in text.split():
        try:
            yield float(part)
        except ValueError:
            continue
