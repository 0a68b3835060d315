"""Invariant on the result of a goal for which there is more than one reason to end."""

from collections import Counter
from collections.abc import Callable
from typing import Final

from controller.action_goals import GoalStatus
from controller.trajectory.goal_result import ErrorCode
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from hal.types import JointState
from servoloop.campaign.invariants.invariant import Invariant
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.goal_log import LoggedGoal

SURE_CYCLES: Final = 1.5
"""Number of cycles between two events after which their order is certain."""
FOLLOWED_CYCLES: Final = 3
"""Number of cycles on the path of a goal after which the goal can no longer be put back into the waiting state."""


class FirstReasonDecides(Invariant):
    """The result of a goal states the first reason for which the goal ends.

    A goal that a client cancels ends as canceled, even if it is replaced while the arm brakes. A goal that is aborted
    because of a deviation keeps this result, even if it is canceled or replaced before the joints are at rest.
    """

    name = "first reason decides"
    of_each_arm = True

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._cycles = Counter[int]()
        """Number of cycles that the arm has spent on the path of each goal."""
        self._left_s: dict[int, float] = {}
        """Time at which the arm left the path of each goal, in seconds."""

    def on_state(self, state: JointState) -> None:
        newest, tracking, now_s = self.newest_goal, self.arm.tracking, self.stack.clock.now()
        if newest is not None and not newest.handle.done and tracking is not None:
            if tracking.on_goal:
                self._cycles[id(newest)] += 1
                self._left_s.pop(id(newest), None)
            elif self._cycles[id(newest)]:
                self._left_s.setdefault(id(newest), now_s)
        for logged in self.stack.ended_goals:
            cycles, left_s = self._cycles.pop(id(logged), 0), self._left_s.pop(id(logged), None)
            if logged.controller == self.arm.name and cycles >= FOLLOWED_CYCLES:
                self._examine(logged, left_s, now_s)

    def _examine(self, logged: LoggedGoal, left_s: float | None, now_s: float) -> None:
        handle, sure_s = logged.handle, SURE_CYCLES * self.stack.loop.period_s
        replaced_s = self._replaced_s(logged, now_s)
        replaced = handle.status is GoalStatus.ABORTED and handle.error_code == ErrorCode.INVALID_GOAL
        if logged.cancel_s is None:
            if left_s is not None:
                self.examined += 1
                if replaced and replaced_s - left_s > sure_s:
                    self.say(f"a goal left its path at {left_s:.2f} s, but its result is: {handle.error_text}")
            return
        self.examined += 1
        if left_s is not None and logged.cancel_s - left_s > sure_s:
            if handle.status is GoalStatus.CANCELED:
                self.say(f"a goal left its path at {left_s:.2f} s, but ended as canceled at {logged.cancel_s:.2f} s")
        elif replaced and replaced_s - logged.cancel_s > sure_s:
            self.say(f"a goal was canceled at {logged.cancel_s:.2f} s, but its result is: {handle.error_text}")

    def _replaced_s(self, logged: LoggedGoal, now_s: float) -> float:
        """Return the time at which a newer goal was sent, or else ``now_s``, in seconds."""
        goals = [one for one in self.stack.goals.goals if one.controller == self.arm.name]
        return min((one.sent_s for one in goals[goals.index(logged) + 1 :]), default=now_s)
