"""Motions on a local control stack. Each goal is split into one part for each controller that moves its joints."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Protocol

from controller.action_goals import PREEMPTED, GoalStatus
from controller.forward.forward_command_controller import ForwardCommandController
from controller.gripper.gripper_action_controller import GripperActionController
from controller.interface import Controller
from controller.trajectory.goal_result import PREEMPTED_BY_TOPIC
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from hal.types import Interface, JointState, joints_of
from servoloop.api.arm_errors import ArmEndedError, MotionCanceledError, MotionFailedError

Mover = JointTrajectoryController | ForwardCommandController | GripperActionController
"""Controller that can move joints to positions."""
TRAJECTORY: Final = "/JointTrajectoryController"
FORWARD: Final = ("/ForwardCommandController", "/JointGroupPositionController")
GRIPPER: Final = "/GripperActionController"
CANCELED: Final = "the motion was canceled; the arm holds its position"
REPLACED: Final = "another motion has replaced this motion"


class MotionPart(Protocol):
    """Part of a motion that one controller executes."""

    @property
    def controller(self) -> Mover:
        """Controller that executes the part."""
        ...

    @property
    def done(self) -> bool:
        """Whether the part has ended."""
        ...

    @property
    def failure(self) -> MotionFailedError | None:
        """Error of the part if it has failed, otherwise None."""
        ...

    @property
    def moves(self) -> bool:
        """Whether the part is running and has not been canceled."""
        ...

    def begin_after_arm(self) -> None:
        """Start the part just after the trajectory of the same motion."""
        ...

    def update(self, state: JointState, now_s: float) -> None:
        """Advance the part after a cycle, in the loop's thread."""
        ...

    def cancel(self, replaced: bool = False) -> None:
        """Cancel the part. The moving joints slow down and hold their positions.

        ``replaced``: Whether another motion follows immediately.
        """
        ...


@dataclass(slots=True)
class RunningMotion:
    """Progress of a goal on a local stack."""

    parts: tuple[MotionPart, ...]
    ended: Callable[[], ArmEndedError | None]

    @property
    def done(self) -> bool:
        """Whether all parts or the control loop have ended."""
        return all(part.done for part in self.parts) or self.ended() is not None

    @property
    def failure(self) -> Exception | None:
        """First failure of a part, ArmEndedError if the loop ended before all parts succeeded, or None."""
        ended = self.ended()
        if ended is not None and any(not part.done or part.failure is not None for part in self.parts):
            return ended
        return next((part.failure for part in self.parts if part.failure is not None), None)


def joints_of_mover(controller: Controller) -> tuple[str, ...]:
    """Return the joints that a controller can move to positions, or an empty tuple for all other controllers.

    The function compares the type's name instead of its class, because a test may wrap a controller.
    """
    positions = all(Interface.parse(name).kind == "position" for name in controller.command_interfaces)
    if not positions or not controller.kind.endswith((TRAJECTORY, *FORWARD, GRIPPER)):
        return ()
    return tuple(joints_of(controller.command_interfaces))


def failure_of(status: GoalStatus, text: str, joints: Sequence[str]) -> MotionFailedError | None:
    """Return the error for a goal with this status and result message, or None while the goal is running and after
    success."""
    if status in (GoalStatus.EXECUTING, GoalStatus.SUCCEEDED):
        return None
    if status is GoalStatus.CANCELED:
        return MotionCanceledError(CANCELED)
    if text in (PREEMPTED, PREEMPTED_BY_TOPIC):
        return MotionCanceledError(REPLACED)
    return MotionFailedError(failed_text(text), joint_in(text, joints))


def failed_text(text: str) -> str:
    """Return the message for a failed motion, with the reason and the remedy."""
    return (
        f"the motion stopped before it reached its target: {text.rstrip('.')}. The arm holds its position. Remove the "
        "cause, then move again"
    )


def joint_in(text: str, joints: Sequence[str]) -> str:
    """Return the first joint that a message names, or an empty string."""
    return next((word for word in re.findall(r"\w+", text) if word in joints), "")
