"""Check robot states against constraints, one by one, and report the results like MoveIt."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from moveit_msgs.msg import Constraints

from nodes.planning.conversion.constraints import ConstraintReader
from nodes.planning.conversion.frames import Frames
from planning.constraints import LinkRegion, PathConstraints
from planning.motion import State
from planning.robot import PlanningRobot
from planning.scene import Pose


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Result for one constraint."""

    distance: float
    """Distance from the center of the constraint, in rad or m."""
    text: str = ""
    """Description of the violation, or empty if the constraint is satisfied."""


class ConstraintChecks:
    """Checker of states against the constraints in a message, in MoveIt's order: joints, positions, orientations.

    Raises:
        RequestError, PlanningError: A constraint is invalid.
    """

    def __init__(self, robot: PlanningRobot, reader: ConstraintReader, message: Constraints) -> None:
        self._robot = robot
        self._tip = reader.tip
        self._parts = [(one, reader.path(one)) for one in _singles(message)]

    def results(self, state: State, frames: Frames) -> list[Evaluation]:
        """Return a result for each constraint, given the robot's frames in one state."""
        return [
            self._joint(message, path, state) if message.joint_constraints else self._region(message, path, frames)
            for message, path in self._parts
        ]

    def broken(self, state: State, frames: Frames) -> str:
        """Describe the first constraint that a state violates, or return an empty string."""
        return next((one.text for one in self.results(state, frames) if one.text), "")

    def _joint(self, message: Constraints, path: PathConstraints, state: State) -> Evaluation:
        (asked,) = message.joint_constraints
        name = asked.joint_name
        if name not in path.joints:
            return Evaluation(0.0)  # This joint mimics another joint.
        lower, upper = path.joints[name]
        away = state[name] - asked.position
        if self._robot.description.joints[name].kind == "continuous":
            away = math.remainder(away, 2.0 * math.pi)
        if lower <= asked.position + away <= upper:
            return Evaluation(abs(away))
        text = f"{name} is at {state[name]:.4f}, outside its path constraint {lower:.4f} to {upper:.4f}"
        return Evaluation(abs(away), text)

    def _region(self, message: Constraints, path: PathConstraints, frames: Frames) -> Evaluation:
        (region,) = path.regions
        tool = _tool(region, frames, self._tip)
        distance_m, angle_rad = region.goal.distances(tool)[0].tolist()
        is_position = bool(message.position_constraints)
        away, unit = (distance_m, "m") if is_position else (angle_rad, "rad")
        if region.goal.contains(tool)[0]:
            return Evaluation(away)
        return Evaluation(away, f"{region.link} is outside its path constraint, {away:.3f} {unit} from its center")


def _tool(region: LinkRegion, frames: Frames, tip: str | None) -> np.ndarray:
    """Return the pose (1, 4, 4) of the frame that a region constrains."""
    pose: Pose = frames.in_base(region.link or tip or "") @ region.offset
    tool = np.eye(4)
    tool[:3, :3], tool[:3, 3] = pose.matrix, pose.position_m
    return tool[None]


def _singles(message: Constraints) -> Iterator[Constraints]:
    """Yield each constraint of a message as a separate message."""
    for field in ("joint_constraints", "position_constraints", "orientation_constraints", "visibility_constraints"):
        for one in getattr(message, field):
            yield Constraints(**{field: [one]})
