"""Read and check the parameters of the pick-place node without ROS."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Self

import numpy as np
from pydantic import BaseModel, Field, ValidationError, model_validator

from controller.manager.controllers_file import ControllersFile
from controller.manager.node_parameters import names, parameters_of
from controller.manager.parameter_file import ALL, PARAMETERS, read_parameter_file
from hal.compensation.gravity import Gravity
from hal.compensation.gravity_compensation import LARGEST_LOAD
from hal.errors import ArmFileError
from hal.plausible import Position
from hal.robot_description.description import Description, UrdfJoint
from hal.robot_file.robot import Robot
from hal.yaml_file import mistakes
from sim_backend.scene.scene_file import scene_model
from sim_backend.scene.world import READY

if TYPE_CHECKING:
    from nodes.pick_place.settings import Settings


NODE: Final = "vision_pick_place_controller"
Pose = Annotated[tuple[Position, ...], Field(min_length=1)]


class PickPlacePoses(BaseModel):
    """Ready and pick poses of every job, in rad."""

    ready: Pose
    pick: Pose


class PickPlace(BaseModel):
    """Parameters that depend on the arm and its cell. The node reads all other parameters itself."""

    joints: tuple[str, ...]
    """Joints of the arm, without the hand, in the order of all poses."""
    poses: PickPlacePoses
    grades: tuple[str, ...]
    bins: dict[str, Pose]
    """Pose above the bin of each grade, in rad."""
    hand_open_m: Position
    """Position of the open hand, in m, or in rad if the hand has a revolute joint."""
    hand_closed_m: Position

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        homeless = [grade for grade in self.grades if grade not in self.bins]
        short = [name for name, pose in self.all_poses().items() if len(pose) != len(self.joints)]
        if homeless or short:
            problems = [f"grade {grade} has no pose under bins" for grade in homeless]
            problems += [f"{name} must have {len(self.joints)} numbers, one per joint" for name in short]
            raise ValueError("; ".join(problems))
        self.settings()  # raises ValueError if the node would reject the parameters
        return self

    def all_poses(self) -> dict[str, Pose]:
        """Return every pose by its name in the file."""
        bins = {f"bins.{grade}": pose for grade, pose in self.bins.items()}
        return {"poses.ready": self.poses.ready, "poses.pick": self.poses.pick, **bins}

    def settings(self) -> "Settings":
        """Return the settings of the node, with default times."""
        from nodes.pick_place.settings import Settings

        return Settings(
            joints=self.joints,
            ready_rad=self.poses.ready,
            pick_rad=self.poses.pick,
            bins_rad={grade: self.bins[grade] for grade in self.grades},
            hand_open_m=self.hand_open_m,
            hand_closed_m=self.hand_closed_m,
        )


def load_pick_place(path: Path) -> PickPlace:
    """Read the parameter file. Raises ArmFileError with the file and line of every mistake."""
    if not path.exists():
        raise ArmFileError(
            f"{path} is missing: demo, simulate and bench arm need its poses. Write the file as described in "
            "docs/arms/README.md, or use servoloop up, which does not need the file"
        )
    file, content = read_parameter_file(path, ArmFileError)
    if not names(content, NODE) and ALL not in content:
        raise ArmFileError(f"{path}:1: {NODE} is missing: put the parameters under '{NODE}: {PARAMETERS}:'")
    try:
        return PickPlace.model_validate(parameters_of(content, NODE))
    except ValidationError as error:
        raise ArmFileError("\n".join(mistakes(file, error, (NODE, PARAMETERS), NODE))) from error


POSE_RAD: Final = 1e-3
"""Largest accepted difference between the ready pose and the keyframe of the scene, in rad."""
ARM: Final = "arm_controller"
HAND: Final = "hand_controller"
"""Fixed names of the controllers that the node uses."""


def pose_problems(pick_place: PickPlace, description: Description) -> Iterator[str]:
    """Yield a problem for each unknown joint and for each pose outside the joint limits."""
    yield from (f"the URDF has no joint {name}" for name in pick_place.joints if name not in description.joints)
    for name, pose in pick_place.all_poses().items():
        for joint, position in zip(pick_place.joints, pose, strict=True):
            if joint in description.joints:
                yield from _outside(name, description.joints[joint], position)


def controller_problems(pick_place: PickPlace, controllers: ControllersFile, description: Description) -> Iterator[str]:
    """Yield a problem if the joints differ from those of the arm controller or the hand would exceed its limits."""
    driven = {spec.name: tuple(getattr(spec.parameters, "joints", ())) for spec in controllers.controllers}
    if driven.get(ARM) != pick_place.joints:
        yield f"joints must list the joints of {ARM} in {controllers.path}, in the same order"
    for joint in driven.get(HAND, ()):
        yield from _outside("hand_open_m", description.joints[joint], pick_place.hand_open_m)
        yield from _outside("hand_closed_m", description.joints[joint], pick_place.hand_closed_m)


def _outside(name: str, joint: UrdfJoint, position: float) -> Iterator[str]:
    if not joint.lower <= position <= joint.upper:
        yield f"{name}: {position:g} is outside the limits {joint.lower:g} to {joint.upper:g} of {joint.name}"


def ready_problems(pick_place: PickPlace, scene: Path) -> Iterator[str]:
    """Yield a problem for each joint whose ready position differs from the keyframe of the scene.

    The scene places new cubes by this keyframe.
    """
    try:
        model = scene_model(scene)
        places = {joint: model.joint(joint).qposadr[0] for joint in pick_place.joints}
        ready = model.key(READY).qpos
    except (ArmFileError, KeyError):
        return  # the check of the scene reports this problem
    for joint, position in zip(pick_place.joints, pick_place.poses.ready, strict=True):
        there = ready[places[joint]]
        if abs(there - position) > POSE_RAD:
            yield f"poses.ready has {joint} at {position:g}, but keyframe {READY} of {scene.name} has it at {there:g}"


def load_problems(pick_place: PickPlace, robot: Robot, description: Description) -> Iterator[str]:
    """Yield a problem for each pose in which gravity overloads a servo."""
    gravity = Gravity(description, [joint.name for joint in robot.joints])
    for name, pose in pick_place.all_poses().items():
        held = dict(zip(pick_place.joints, pose, strict=True))
        torques = gravity.torques(np.array([held.get(joint.name, 0.0) for joint in robot.joints]))
        for joint, torque in zip(robot.joints, torques.tolist(), strict=True):
            if abs(torque) > LARGEST_LOAD * joint.full_effort * joint.torque_limit:
                yield (
                    f"{name}: gravity loads {joint.name} with {abs(torque):.2f}, more than {LARGEST_LOAD:.0%} of the "
                    f"maximum effort of its servo"
                )
