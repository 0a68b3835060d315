"""Combine the folders of several arms into one robot folder."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from commissioning.atomic_write import make_folder, write_file
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from drivers.paths import resolved
from hal.hal_errors import ArmFileError
from hal.robot_description.link_meshes import PLACES
from hal.robot_file.servo_models import FILE_NAME
from servoloop.arms import combined_files as texts
from servoloop.arms.combined_names import BasePose, Part
from servoloop.arms.combined_urdf import combined_urdf
from servoloop.arms.new_urdf import ROBOT_FILE
from servoloop.extras import missing_extras
from servoloop.manual.poses import FILE as POSES_FILE
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.shipped_files import ARM_FILE

TRAJECTORY: Final = JointTrajectoryController.kind
NAME: Final = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
APART_M: Final = 0.6
"""Distance between the bases of two arms if ``--base`` is not given, in m."""
SHOWN: Final = 3
"""Maximum number of overlapping pairs listed in a message."""


def parse_arms(words: Sequence[str]) -> dict[str, str]:
    """Return the arm for each prefix, parsed from arguments such as ``left=so101``. Raises ArmFileError."""
    arms: dict[str, str] = {}
    for word in words:
        name, separator, arm = word.partition("=")
        if not separator or not arm or not NAME.fullmatch(name):
            raise ArmFileError(
                f"{word!r} is not PREFIX=ARM, such as left=so101: write the prefix in lowercase letters, digits and _"
            )
        if name in arms:
            raise ArmFileError(f"the prefix {name} is given twice: choose a different prefix for each arm")
        arms[name] = arm
    if len(arms) < 2:
        raise ArmFileError("specify at least two arms, such as left=so101 right=so101")
    if "world" in arms:
        raise ArmFileError("the prefix world is reserved for the feed of the simulated world: choose another prefix")
    return arms


def parse_bases(words: Sequence[str], names: Sequence[str]) -> dict[str, BasePose]:
    """Return the base pose of each arm, parsed from arguments such as ``left=0,0.3,0,0``. Raises ArmFileError.

    An arm without such an argument is placed next to the other arms.
    """
    middle = 0.5 * (len(names) - 1)
    bases = {name: BasePose(0.0, (middle - place) * APART_M, 0.0, 0.0) for place, name in enumerate(names)}
    given: set[str] = set()
    for word in words:
        name, _, text = word.partition("=")
        if name not in bases:
            raise ArmFileError(f"--base {word}: there is no arm {name}; choose one of {', '.join(names)}")
        if name in given:
            raise ArmFileError(f"--base {name}= is given twice: give one base pose for each arm")
        bases[name] = _base(word, text)
        given.add(name)
    return bases


def _base(word: str, text: str) -> BasePose:
    try:
        numbers = [float(number) for number in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 4 or not all(abs(number) <= 100.0 for number in numbers):  # This also rejects NaN.
        raise ArmFileError(
            f"--base {word}: write PREFIX=X,Y,Z,YAW in m and rad, such as left=0,0.3,0,0, with each number at most 100"
        )
    return BasePose(*numbers)


def combine(folder: Path, arms: Mapping[str, str], bases: Mapping[str, BasePose]) -> list[Path]:
    """Write the folder of a robot with several arms. The folder name becomes the robot name.

    The scene and the planning groups are written only if the ``sim`` extra is installed and each arm has a scene.

    Args:
        folder: New folder.
        arms: Name or folder of each arm, keyed by the arm's name in the robot, such as ``left``.
        bases: Base pose of each arm.

    Returns:
        Paths of the written files.

    Raises:
        ArmFileError: The folder cannot be used, or the arms cannot be combined.
        HalError, ControllersFileError: The files of an arm have errors.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ArmFileError(f"{folder} already exists: choose another folder, or remove it first")
    if not resolved(folder).name.isprintable():
        raise ArmFileError(f"{folder.name!r} cannot be the name of an arm: use printable characters")
    made = combined(folder, arms, bases)
    for path in {(folder / file).parent for file in made}:
        make_folder(path)
    for file, text in made.items():
        write_file(folder / file, text, keep=False)
    return [folder / file for file in made]


def combined(folder: Path, arms: Mapping[str, str], bases: Mapping[str, BasePose]) -> dict[str, str]:
    """Return the text of each file for a folder, keyed by file name. Raises the same errors as ``combine``."""
    parts = [_part(name, arm, bases[name]) for name, arm in arms.items()]
    name = resolved(folder).name
    in_scene = not missing_extras("the scene", "sim") and all(part.arm.scene.exists() for part in parts)
    heights_m = _heights_m(parts) if in_scene else {part.name: part.base.z_m for part in parts}
    files = {
        ARM_FILE: texts.arm_text(parts),
        "arm.urdf": combined_urdf(name, parts, heights_m, folder),
        ROBOT_FILE: texts.robot_text(parts),
        "controllers.yaml": texts.controllers_text(parts),
        POSES_FILE: texts.poses_text(parts),
        FILE_NAME: texts.servo_models_text(parts),
        str(PLACES): texts.meshes_text(parts, resolved(folder)),
        **dict(texts.licenses(parts)),
    }
    if in_scene:
        files |= _simulated(name, parts, heights_m)
    return {file: text for file, text in files.items() if text}


def _part(name: str, arm: str, base: BasePose) -> Part:
    found = find_arm(arm)
    files = read_arm_files(found)
    if sum(spec.kind == TRAJECTORY for spec in files.controllers.controllers) > 1:
        raise ArmFileError(f"{found.name} already has several arms: combine its individual arms instead")
    return Part(name, found, files, base)


def _simulated(name: str, parts: Sequence[Part], heights_m: Mapping[str, float]) -> dict[str, str]:
    """Return the scene, the planning groups and the parameters of the pick-and-place nodes."""
    from servoloop.arms.combined_srdf import combined_srdf
    from sim_backend.scene.combined_scene import PlacedArm, combined_scene

    placed = [
        PlacedArm(part.prefix, part.arm.scene, (part.base.x_m, part.base.y_m, heights_m[part.name]), part.base.yaw_rad)
        for part in parts
    ]
    scene = combined_scene(name, placed, _table_m(parts[0]))
    _require_apart(scene, parts)
    jobs = texts.pick_place_text(parts) if all(part.arm.pick_place.exists() for part in parts) else ""
    return {"scene.xml": scene, f"{name}.srdf": combined_srdf(name, parts), "pick_place.yaml": jobs}


def _table_m(part: Part) -> float:
    from sim_backend.scene.combined_scene import table_height_m

    return table_height_m(part.arm.scene)


def _heights_m(parts: Sequence[Part]) -> dict[str, float]:
    """Return the base height of each arm at which all arms stand on the first arm's table."""
    table_m = _table_m(parts[0])
    return {part.name: part.base.z_m + round(table_m - _table_m(part), 6) for part in parts}


def _require_apart(scene: str, parts: Sequence[Part]) -> None:
    """Raise ArmFileError if parts of two arms overlap in the zero, start or park pose."""
    from sim_backend.scene.combined_scene import contacts_between, keyframes

    park = {
        f"{part.prefix}{joint}": position
        for part in parts
        if part.files.robot.file.park is not None
        for joint, position in part.files.robot.file.park.pose.items()
    }
    poses = {"zero": {}, "park": park, **keyframes(scene)}
    for name, pose in poses.items():
        pairs = list(dict.fromkeys(contacts_between(scene, pose)))
        if pairs:
            shown = ", ".join(f"{one} and {other}" for one, other in pairs[:SHOWN])
            more = f" and {len(pairs) - SHOWN} more pairs" if len(pairs) > SHOWN else ""
            raise ArmFileError(
                f"the arms overlap in the pose {name} ({shown}{more}): place them further apart with "
                f"--base {parts[-1].name}=X,Y,Z,YAW"
            )
