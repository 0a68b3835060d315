"""Invariant on trajectories that wait: for measurements, and for other controllers."""

from collections.abc import Callable
from typing import Final

import numpy as np

from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from controller.trajectory.sampler import Tracking
from hal.types import JointState
from servoloop.campaign.invariants.invariant import UNREAD, Invariant
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.goal_log import LoggedGoal

UNMEASURED_CYCLES: Final = 2
"""Number of cycles without measurements after which a trajectory must wait."""
ARRIVED_SHARE: Final = 0.04
"""Maximum distance from its goal at which a joint may count as having arrived, as a fraction of its range. It includes
the tolerance of a reading."""
STILL_S: Final = 0.1
"""Minimum time at rest for a joint to count as stalled, in seconds."""
LONGEST_STEP: Final = 2.0
"""Maximum time by which a trajectory advances in a late cycle, in periods."""
AWAY: Final = 0.1
"""Following error of a joint at which a tolerance may end each trajectory from the topic at once, in rad or m."""
RECOVERED_S: Final = 0.2
"""Time after a fault of a joint in which its errors may be large, in seconds."""
TOPIC_CYCLES: Final = 5
"""Maximum number of cycles until a trajectory from the topic begins."""
ROUNDING: Final = 1e-6
"""Rounding error of the time by which a trajectory advances, in periods."""
TRAVELS_SHARE: Final = 0.1
"""Minimum speed of a joint that travels, as a fraction of its velocity limit."""


class TrajectoriesWait(Invariant):
    """While none of an arm's joints can be measured, its trajectory waits. A single cycle without measurements does not
    count.

    In a late cycle, a trajectory advances by at most two periods.

    A goal also waits for the controllers in ``wait_for``: their joints have arrived, or no longer move, when it begins.
    It does not wait longer than ``wait_for_timeout``. Trajectories from the topic do not wait.
    """

    name = "trajectories wait"
    of_each_arm = True

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._cycles = 0
        """Number of consecutive cycles in which no joint of the arm was measured."""
        self._before: Tracking | None = None
        self._begun_goal: LoggedGoal | None = None
        """The latest goal that has begun, or that has already ended in the cycle in which it began."""
        self._topic_cycles = 0
        """Number of consecutive cycles in which no trajectory from the topic has begun."""
        self._begun = 0
        """Number of the arm's goals that had begun by the last cycle."""
        self._true = self.true_positions()
        self._sent: dict[str, tuple[tuple[float, ...] | None, float]] = {}
        """Latest values sent to each controller in ``wait_for``, and the time at which they were sent. The time is -1
        if the joints no longer need to move to these values."""

    def on_state(self, state: JointState) -> None:
        tracking = self.arm.tracking
        self._examine_measured(state, tracking)
        self._examine_topic(state, tracking)
        if not self.arm.parameters.wait_for:
            return
        self._note_values(state.stamp_s)
        if tracking is not None and tracking.on_goal and self._begins(state.stamp_s):
            for name in self._sent:
                self._examine_other(name, state)
        self._true = self.true_positions()

    def _examine_measured(self, state: JointState, now: Tracking | None) -> None:
        unread = all(name in state.faults and state.faults[name].kind in UNREAD for name in self.arm.joints)
        self._cycles = self._cycles + 1 if unread and now is not None and self.active else 0
        before, self._before = self._before, now
        if now is None or before is None or before.path is not now.path or not now.on_goal:
            return
        advanced_s = now.elapsed_s - before.elapsed_s
        if self._cycles > UNMEASURED_CYCLES:
            self.examined += 1
            if advanced_s > 0.0:
                self.say(f"the trajectory goes on at {now.elapsed_s:.2f} s although no joint is measured")
        elif advanced_s > (LONGEST_STEP + ROUNDING) * self.stack.loop.period_s and now.rate > 0.0:
            self.say(f"the trajectory advances by {advanced_s:.3f} s in one cycle")

    def _examine_topic(self, state: JointState, tracking: Tracking | None) -> None:
        """Check that trajectories from the topic begin at once, even while other controllers move."""
        goal, running = self.newest_goal, self.stack.manager.registry.loaded[self.arm.name].active
        away = tracking is not None and not np.abs(tracking.error).max() < AWAY
        touched = any(self.stack.touches.since_s(joint) < RECOVERED_S for joint in self.arm.joints)
        if tracking is None or tracking.on_goal or away or touched:
            self._begun_goal = goal  # The goal has begun, or its tolerances may have ended it in its first cycle.
        begins_later = goal is not None and goal is not self._begun_goal and goal.goal.from_topic
        runs = goal is not None and not goal.handle.done and goal.cancel_s is None
        faulty = self.upset or not state.faults.keys().isdisjoint(self.arm.joints)
        if not (begins_later and runs) or faulty or not (running and self.active):
            self._topic_cycles = 0
            return
        self._topic_cycles += 1
        if self._topic_cycles > TOPIC_CYCLES:
            self.say(f"{self.arm.name} does not follow its topic")

    def _note_values(self, now_s: float) -> None:
        """Note the values of the other controllers, and whether their joints are still moving to them."""
        commands = dict(zip(self.commanded, self.stack.loop.command.tolist(), strict=True))
        for name in self.arm.parameters.wait_for:
            controller = self.stack.controllers.get(name)
            if controller is None or not self.stack.manager.registry.loaded[name].active or controller.upsets:
                self._sent.pop(name, None)
            elif name not in self._sent or self._sent[name][0] != controller.forwarded:
                values = controller.forwarded
                stays = values is None or all(commands[j] == v for j, v in zip(controller.joints, values, strict=True))
                self._sent[name] = values, -1.0 if stays else now_s
            elif now_s - self._sent[name][1] > STILL_S and not all(map(self._travels, controller.joints)):
                self._sent[name] = controller.forwarded, -1.0  # A stalled joint may move again later.

    def _travels(self, joint: str) -> bool:
        """Return whether a joint has moved since the previous cycle."""
        limit = self.stack.loop.limits[self.commanded.index(joint)]
        moved = abs(self.true_positions()[joint] - self._true[joint])
        return moved > TRAVELS_SHARE * limit.velocity * self.stack.loop.period_s

    def _begins(self, now_s: float) -> bool:
        """Return whether the latest goal begins in this cycle, before ``wait_for_timeout`` allows it to begin without
        waiting. If a goal is canceled before it begins, the tracking still belongs to the previous goal.
        """
        own = [logged for logged in self.stack.goals.goals if logged.controller == self.arm.name]
        begins, self._begun = len(own) > self._begun, len(own)
        if not begins or own[-1].goal.from_topic or own[-1].cancel_s is not None:
            return False
        return now_s - own[-1].sent_s < self.arm.parameters.wait_for_timeout - 2.0 * self.stack.loop.period_s

    def _examine_other(self, name: str, state: JointState) -> None:
        values, since_s = self._sent[name]
        if values is None or since_s < 0.0:
            return
        true = self.true_positions()
        for joint, value in zip(self.stack.controllers[name].joints, values, strict=True):
            limit = self.stack.loop.limits[self.commanded.index(joint)]
            end, near = min(max(value, limit.lower), limit.upper), ARRIVED_SHARE * (limit.upper - limit.lower)
            if joint in state.faults or self.deceived(joint) or self.stack.touches.since_s(joint) < 1.0:
                continue
            self.examined += 1
            if min(abs(true[joint] - end), abs(self._true[joint] - end)) > near:
                self.say(f"a goal begins although {joint} is still at {true[joint]:.4f} on its way to {end:.4f}")
