"""Describe the arm of a control stack for its backend."""

import math
from collections.abc import Sequence
from contextlib import suppress

from hal.errors import ArmFileError
from hal.types import joints_of
from servoloop.api.backend import ArmDescription
from servoloop.stack.arm_folders import read_arm
from servoloop.stack.control_stack import ControlStack
from servoloop.stack.pick_place import HAND, load_pick_place
from servoloop.stack.robot_files import Files


def describe(stack: ControlStack) -> ArmDescription:
    """Return the properties of an arm for its backend."""
    files, loop = stack.files, stack.loop
    names = joints_of(loop.hardware.command_interfaces)
    joints = tuple(name for name, kind in zip(names, loop.kinds, strict=True) if kind == "position")
    limits = dict(zip(names, loop.limits, strict=True))
    hand = _hand(files, joints)
    opened, closed = _hand_positions(files, hand)
    return ArmDescription(
        files.arm, joints, {j: limits[j] for j in joints}, hand, opened, closed, loop.period_s, files.folder
    )


def _hand(files: Files, joints: Sequence[str]) -> str:
    """Return the joint of the gripper: the only joint of the hand controller, or of all joints without a trajectory."""
    by_controller = {spec.name: spec for spec in files.controllers.controllers}
    if HAND in by_controller:
        found = [name for name in joints_of(by_controller[HAND].parameters.claims()) if name in joints]
    else:
        trajectories = [one for one in by_controller.values() if one.kind.endswith("JointTrajectoryController")]
        driven = {joint for one in trajectories for joint in joints_of(one.parameters.claims())}
        found = [joint for joint in joints if joint not in driven]
    return found[0] if len(found) == 1 else ""


def _hand_positions(files: Files, hand: str) -> tuple[float, float]:
    """Return the positions of the open and the closed gripper.

    The pick-and-place parameters of the arm name them. Without these parameters they are the limits of the joint.
    """
    if not hand:
        return math.nan, math.nan
    with suppress(ArmFileError):
        if files.folder is not None:
            settings = load_pick_place(read_arm(files.folder).pick_place)
            return settings.hand_open_m, settings.hand_closed_m
    return files.limits[hand].upper, files.limits[hand].lower
