"""Read an arm's files for planning: its scene, limits, groups, named states and pairs that may touch."""

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from controller.trajectory.parameters import TrajectoryParameters
from hal.hal_errors import ArmFileError
from planning.arm_model import ArmModel
from planning.collision import PADDING_M
from planning.groups import Group, Groups, States, derive_groups, outside
from planning.planning_errors import PlanningError
from planning.robot import PlanningRobot
from planning.srdf_file import read_pairs, read_srdf
from servoloop.manual.poses import PoseError, Poses
from servoloop.motion_planning.collision_matrix import near_by_design, reasons
from servoloop.stack.arm_folders import read_arm
from servoloop.stack.pick_place import load_pick_place
from servoloop.stack.robot_files import Files
from servoloop.stack.shipped_files import CONFIG
from sim_backend.scene.scene_file import scene_spec

LOG = logging.getLogger("servoloop")
NEVER: Final = "Never"
"""Reason for pairs that did not touch in any of the random poses.

These pairs are still checked unless they are near by design, because they may touch in other poses.
"""
POSES: Final = 500
"""Number of random poses used to find the links that always touch."""
SEED: Final = 1
"""Random seed for the poses."""


def planning_robot(files: Files) -> PlanningRobot:
    """Read the files of an arm for planning.

    Groups, end effectors, named states and pairs that may touch are read from the arm's SRDF, if it has one. The SRDF
    is the only ``*.srdf`` file in the arm's folder, or the file in ``config/moveit`` with the arm's name.

    If the arm does not have an SRDF, the ``arm`` group contains the joints of the first trajectory controller, and the
    ``hand`` group contains the other joints. In this case, the named states are the poses of the pick-and-place job,
    the robot file and ``servoloop pose``. Poses outside the joint limits are logged and left out.

    Raises:
        HalError: The arm's files have errors, or the arm has no trajectory controller.
        PlanningError: A joint is missing from the scene file, or the SRDF has errors.
    """
    model = scene_spec(files.scene).compile()
    srdf = srdf_of(files)
    if srdf is not None:
        groups, pairs = read_srdf(srdf, files.description), read_pairs(srdf)
    else:
        groups, pairs = _derived(files, model), reasons(files.scene, POSES, SEED)
    near = near_by_design(files.scene, PADDING_M, POSES, SEED)
    touching = [links for links, why in pairs.items() if why != NEVER or links in near]
    return PlanningRobot(model, files.description, files.limits, groups, touching)


def srdf_of(files: Files) -> Path | None:
    """Return the SRDF of an arm, or None if the arm does not have one.

    Raises PlanningError if the arm's folder contains several SRDF files.
    """
    own = sorted(files.arm_folder.glob("*.srdf"))
    if len(own) > 1:
        names = ", ".join(path.name for path in own)
        raise PlanningError("INVALID_ROBOT_STATE", f"{files.arm_folder} has several SRDF files: keep one of {names}")
    shared = CONFIG / "moveit" / f"{files.arm}.srdf"
    return own[0] if own else shared if shared.is_file() else None


def arm_group(robot: PlanningRobot, files: Files) -> Group:
    """Return the group of the arm's first trajectory controller. Raises ArmFileError."""
    joints = set(_arm_joints(files))
    for group in robot.groups.groups.values():
        if set(group.joints) == joints:
            return group
    raise ArmFileError(f"no group of the SRDF has exactly the joints {', '.join(sorted(joints))}: add such a group")


def arm_groups(robot: PlanningRobot, files: Files) -> list[Group]:
    """Return the groups that consist only of joints of trajectory controllers.

    The group of ``arm_group`` comes first, followed by the other groups from smallest to largest.

    Raises ArmFileError.
    """
    first, driven = arm_group(robot, files), set[str]()
    for spec in files.controllers.controllers:
        if isinstance(spec.parameters, TrajectoryParameters):
            driven |= set(spec.parameters.joints)
    others = [group for group in robot.groups.groups.values() if driven.issuperset(group.joints) and group != first]
    return [first, *sorted(others, key=lambda group: len(group.joints))]


def _derived(files: Files, model: object) -> Groups:
    joints = _arm_joints(files)
    arm = ArmModel(model, {joint: files.limits[joint] for joint in joints})
    bodies = [int(arm.model.jnt_bodyid[joint]) for joint in arm.joint_ids]
    tool = arm.links[max(arm.bodies.index(body) for body in bodies)]
    return derive_groups(files.description, tuple(files.limits), tool, _states(files, joints))


def _arm_joints(files: Files) -> tuple[str, ...]:
    """Return the joints of the first trajectory controller. Raises ArmFileError."""
    for spec in files.controllers.controllers:
        if isinstance(spec.parameters, TrajectoryParameters):
            return tuple(spec.parameters.joints)
    raise ArmFileError(f"{files.controllers.path} has no {JointTrajectoryController.kind}: add such a controller")


def _states(files: Files, joints: tuple[str, ...]) -> States:
    """Return the poses of an arm, keyed by name, with the positions of the driven joints."""
    states: dict[str, Mapping[str, float]] = {}
    if files.robot.file.park is not None:
        parked = {joint: at for joint, at in files.robot.file.park.pose.items() if joint in joints}
        states |= _possible(files, files.robot_path, {"park": parked})
    job_file = read_arm(files.arm_folder).pick_place
    if job_file.is_file():
        job, hand = load_pick_place(job_file), [joint for joint in files.limits if joint not in joints]
        working = {"ready": dict(zip(job.joints, job.poses.ready, strict=True))}
        if len(hand) == 1:
            working |= {"open": {hand[0]: job.hand_open_m}, "close": {hand[0]: job.hand_closed_m}}
        states |= _possible(files, job_file, working)
    if files.folder is not None:
        states |= _saved(files, Poses(files.folder))
    return states


def _saved(files: Files, poses: Poses) -> States:
    """Return the saved poses. If their file has an error, the error is logged and there are no poses."""
    try:
        return _possible(files, poses.path, poses.all())
    except PoseError as error:
        LOG.warning("the saved poses are not available for planning: %s", error)
        return {}


def _possible(files: Files, path: Path, poses: States) -> States:
    """Return the poses of a file with the positions of the driven joints. A pose outside the joint limits is logged and
    left out, because the measured position of a joint may be outside."""
    states: dict[str, Mapping[str, float]] = {}
    for name, pose in poses.items():
        driven = {joint: at for joint, at in pose.items() if joint in files.limits}
        problems = [text for joint, at in driven.items() if (text := outside(files.description.joints[joint], at))]
        if problems:
            text = "; ".join(problems)
            LOG.warning("%s: pose %s is not available for planning, because %s: correct the position", path, name, text)
        else:
            states[name] = driven
    return states
