"""Check that the pick-place parameters of an arm match its controllers, limits, servos and scene."""

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from controller.manager.controllers_file import ControllersFile
from hal.compensation.gravity import Gravity
from hal.compensation.joint_offset import LARGEST_LOAD
from hal.hal_errors import ArmFileError
from hal.robot_description.description import Description, UrdfJoint
from hal.robot_file.robot import Robot
from hal.types import joints_of
from servoloop.stack.pick_place import PickPlace

POSE_RAD: Final = 1e-3
"""Maximum accepted difference between the ready pose and the keyframe of the scene, in rad."""


def pose_problems(pick_place: PickPlace, description: Description) -> Iterator[str]:
    """Yield a problem for each unknown joint and for each pose outside the joint limits."""
    yield from (f"the URDF has no joint {name}" for name in pick_place.joints if name not in description.joints)
    for name, pose in pick_place.all_poses().items():
        for joint, position in zip(pick_place.joints, pose, strict=True):
            if joint in description.joints:
                yield from _outside(name, description.joints[joint], position)


def controller_problems(pick_place: PickPlace, controllers: ControllersFile, description: Description) -> Iterator[str]:
    """Yield a problem if the joints differ from those of the arm controller, or if the hand would exceed its limits."""
    driven = {spec.name: tuple(joints_of(spec.parameters.claims())) for spec in controllers.controllers}
    if driven.get(pick_place.arm_controller) != pick_place.joints:
        yield f"joints must list the joints of {pick_place.arm_controller} in {controllers.path}, in the same order"
    hand = [
        description.joints[joint] for joint in driven.get(pick_place.hand_controller, ()) if joint in description.joints
    ]
    for joint in hand:
        yield from _outside("hand_open_m", joint, pick_place.hand_open_m)
        yield from _outside("hand_closed_m", joint, pick_place.hand_closed_m)


def _outside(name: str, joint: UrdfJoint, position: float) -> Iterator[str]:
    if not joint.lower <= position <= joint.upper:
        yield f"{name}: {position:g} is outside the limits {joint.lower:g} to {joint.upper:g} of {joint.name}"


def ready_problems(pick_place: PickPlace, scene: Path) -> Iterator[str]:
    """Yield a problem for each joint whose ready position differs from the keyframe of the scene.

    The scene uses this keyframe to place new cubes. The check needs the extra ``sim``.
    """
    from sim_backend.scene.scene_file import scene_model
    from sim_backend.scene.world import READY

    try:
        model = scene_model(scene)
        places = {joint: model.joint(joint).qposadr[0] for joint in pick_place.joints}
        ready = model.key(READY).qpos
    except (ArmFileError, KeyError):
        return  # The check of the scene reports this problem.
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
