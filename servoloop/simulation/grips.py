"""Simulated client of a gripper action controller, which replaces the hand's usual controller."""

from dataclasses import dataclass
from typing import Final

from controller.gripper.goal import GripperGoal, GripperHandle, GripperParameters
from controller.gripper.gripper_action_controller import GripperActionController
from controller.manager.switch import SwitchRequest
from hal.types import JointLimits
from servoloop.simulation.acts import Grip
from servoloop.simulation.stack import SimulatedStack

NAME: Final = "gripper_controller"
TOLERANCE_SHARE: Final = 0.03
"""Goal tolerance of the controller, as a fraction of the joint's range."""


@dataclass(slots=True)
class LoggedGrip:
    """Goal sent by the client. Times are in seconds on the stack's clock; None if the event has not happened."""

    handle: GripperHandle
    sent_s: float
    cancel_s: float | None = None
    """Time of the client's cancel request."""


class GripperClient:
    """Client that sends goals to a gripper action controller for the first joint of the hand."""

    def __init__(self, stack: SimulatedStack) -> None:
        """Add the controller to a stack."""
        self._stack = stack
        joint = stack.hand.joints[0]
        self.limits: JointLimits = stack.files.limits[joint]
        """Joint limits."""
        tolerance = TOLERANCE_SHARE * (self.limits.upper - self.limits.lower)
        self.parameters = GripperParameters(joint=joint, goal_tolerance=tolerance)
        self.controller = GripperActionController(
            NAME, self.parameters, self.limits, stack.loop.hardware.joints.index(joint)
        )
        self.goals: list[LoggedGrip] = []
        """All accepted goals, oldest first."""
        stack.add_controller(self.controller)

    @property
    def active(self) -> bool:
        """Whether the controller drives the hand."""
        return self._stack.manager.registry.loaded[NAME].active

    def grip(self, act: Grip) -> LoggedGrip | None:
        """Activate the controller if it is inactive, and send a goal. Return the goal if it was accepted.

        Raises:
            ManagerError: The controller cannot be activated.
        """
        hand, loop = self._stack.hand.name, self._stack.loop
        if not self.active:
            former = (hand,) if loop.manager.registry.loaded[hand].active else ()
            loop.manager.switch(SwitchRequest(activate=(NAME,), deactivate=former), loop.within_limits)
        position = self.limits.lower + act.share * (self.limits.upper - self.limits.lower)
        goal = GripperGoal(position, act.speed * self.limits.velocity)
        if self.controller.check(goal) is not None:
            return None
        self.goals.append(LoggedGrip(self.controller.submit(goal), self._stack.clock.now()))
        return self.goals[-1]

    def cancel(self, goal: LoggedGrip) -> None:
        """Cancel a goal, unless it has finished."""
        if not goal.handle.done:
            goal.cancel_s = self._stack.clock.now()
            self.controller.cancel(goal.handle)
