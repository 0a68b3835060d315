"""Connect the node's jobs to the arm, either directly through its controllers or through a motion planner."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from rclpy.node import Node

from nodes.pick_place.arm import RosArm
from nodes.ros_environment import RosError
from pick_place.job import JobMotions
from pick_place.joint_motions import JointMotions
from pick_place.pose_motions import PoseMotions
from pick_place.pose_settings import PoseSettings
from pick_place.settings import JobSettings


class ServedArm(Protocol):
    """Arm that is moved through an action server."""

    def wait_for_server(self, timeout_s: float) -> bool:
        """Block until the action server appears, and return whether it appeared in time."""
        ...


@dataclass(frozen=True, slots=True)
class ArmMotions:
    """The arm, and the motions that each job performs with it."""

    arm: ServedArm
    of_job: Callable[[], JobMotions]
    missing: str
    """Message to show if the arm's action server is not available."""


def motions_of(node: Node, settings: JobSettings | PoseSettings) -> ArmMotions:
    """Return the motions for these settings. Raises RosError if the planner's messages are not installed."""
    if isinstance(settings, PoseSettings):
        return _planned(node, settings)
    arm = RosArm(node, settings)
    return ArmMotions(arm, lambda: JointMotions(settings, arm), "the arm is not available yet: start the stack")


def _planned(node: Node, settings: PoseSettings) -> ArmMotions:
    try:
        from nodes.pick_place.planned_arm import PlannedArm  # The messages of the planner may not be installed.
    except ModuleNotFoundError as error:
        raise RosError(f"motion: poses requires the package {error.name}. Run `make setup`") from error
    planner = PlannedArm(node, settings)
    missing = "the motion planner is not available yet: start `servoloop plan-server` or MoveIt"
    return ArmMotions(planner, lambda: PoseMotions(settings, planner), missing)
