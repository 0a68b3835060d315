"""Whether an arm's pick-place parameters fit its controllers, its limits, its servos and its scene."""

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from controller.manager.controllers_file import ControllersFile
from hal.compensation.gravity import Gravity
from hal.compensation.gravity_compensation import LARGEST_LOAD
from hal.errors import ArmFileError
from hal.robot_description.description import Description, UrdfJoint
from hal.robot_file.robot import Robot
from servoloop.arms.pick_place import PickPlace
from sim_backend.scene.scene_file import scene_model
from sim_backend.scene.world import READY

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
