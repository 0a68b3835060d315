"""An arm's pick-place parameters: what the node is started with, read without ROS."""

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
    """The two poses of every job, rad."""

    ready: Pose
    pick: Pose


class PickPlace(BaseModel):
    """The parameters that belong to the arm and its cell; the others are the node's business."""

    joints: tuple[str, ...]
    """The arm's, without the hand: the order of all poses."""
    poses: PickPlacePoses
    grades: tuple[str, ...]
    bins: dict[str, Pose]
    """By grade."""
    hand_open_m: Position
    """rad for a hand whose joint is revolute."""
    hand_closed_m: Position

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        homeless = [grade for grade in self.grades if grade not in self.bins]
        short = [name for name, pose in self.all_poses().items() if len(pose) != len(self.joints)]
        if homeless or short:
            problems = [f"grade {grade} has no pose under bins" for grade in homeless]
            problems += [f"{name} has not one number for each of the {len(self.joints)} joints" for name in short]
            raise ValueError("; ".join(problems))
        self.settings()  # raises ValueError for all that the node's own code refuses
        return self

    def all_poses(self) -> dict[str, Pose]:
        """Every pose by its name in the file."""
        bins = {f"bins.{grade}": pose for grade, pose in self.bins.items()}
        return {"poses.ready": self.poses.ready, "poses.pick": self.poses.pick, **bins}

    def settings(self) -> "Settings":
        """The same for the node's own code, its times as they are by default."""
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
    """Read the file. Raises ArmFileError with every mistake, its file and line."""
    if not path.exists():
        raise ArmFileError(
            f"{path} is missing: demo, simulate and bench arm go to the poses of this file; write it as "
            "docs/arms/README.md describes, or use servoloop up, which needs no such file"
        )
    file, content = read_parameter_file(path, ArmFileError)
    if not names(content, NODE) and ALL not in content:
        raise ArmFileError(f"{path}:1: {NODE} is missing: put the parameters below '{NODE}: {PARAMETERS}:'")
    try:
        return PickPlace.model_validate(parameters_of(content, NODE))
    except ValidationError as error:
        raise ArmFileError("\n".join(mistakes(file, error, (NODE, PARAMETERS), NODE))) from error


POSE_RAD: Final = 1e-3
ARM: Final = "arm_controller"
HAND: Final = "hand_controller"
"""The node's controllers by their names, which are fixed."""


def pose_problems(pick_place: PickPlace, description: Description) -> Iterator[str]:
    """Yields poses outside the joints' limits."""
    yield from (f"the URDF has no joint {name}" for name in pick_place.joints if name not in description.joints)
    for name, pose in pick_place.all_poses().items():
        for joint, position in zip(pick_place.joints, pose, strict=True):
            if joint in description.joints:
                yield from _outside(name, description.joints[joint], position)


def controller_problems(pick_place: PickPlace, controllers: ControllersFile, description: Description) -> Iterator[str]:
    """Yields joints that are not the controllers', and a hand that is told to go beyond its limits."""
    driven = {spec.name: tuple(getattr(spec.parameters, "joints", ())) for spec in controllers.controllers}
    if driven.get(ARM) != pick_place.joints:
        yield f"its joints are not those of {ARM} in {controllers.path}, in their order"
    for joint in driven.get(HAND, ()):
        yield from _outside("hand_open_m", description.joints[joint], pick_place.hand_open_m)
        yield from _outside("hand_closed_m", description.joints[joint], pick_place.hand_closed_m)


def _outside(what: str, joint: UrdfJoint, position: float) -> Iterator[str]:
    if not joint.lower <= position <= joint.upper:
        yield f"{what}: {position:g} is outside the limits {joint.lower:g} to {joint.upper:g} of {joint.name}"


def ready_problems(pick_place: PickPlace, scene: Path) -> Iterator[str]:
    """Yields joints that are elsewhere in the scene's keyframe than at the ready pose, by which cubes are fed."""
    try:
        model = scene_model(scene)
        places = {joint: model.joint(joint).qposadr[0] for joint in pick_place.joints}
        ready = model.key(READY).qpos
    except (ArmFileError, KeyError):
        return  # the scene's own problems say so
    for joint, position in zip(pick_place.joints, pick_place.poses.ready, strict=True):
        there = ready[places[joint]]
        if abs(there - position) > POSE_RAD:
            yield f"poses.ready has {joint} at {position:g}, and {scene.name}'s keyframe {READY} at {there:g}"


def load_problems(pick_place: PickPlace, robot: Robot, description: Description) -> Iterator[str]:
    """Yields poses in which gravity asks more of a servo than it can hold for long."""
    gravity = Gravity(description, [joint.name for joint in robot.joints])
    for name, pose in pick_place.all_poses().items():
        held = dict(zip(pick_place.joints, pose, strict=True))
        torques = gravity.torques(np.array([held.get(joint.name, 0.0) for joint in robot.joints]))
        for joint, torque in zip(robot.joints, torques.tolist(), strict=True):
            if abs(torque) > LARGEST_LOAD * joint.full_effort * joint.torque_limit:
                yield (
                    f"{name}: gravity asks {abs(torque):.2f} of {joint.name}, more than {LARGEST_LOAD:.0%} of what its "
                    f"servo has"
                )
