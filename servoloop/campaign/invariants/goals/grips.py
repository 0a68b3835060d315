"""Invariant on the goals of a gripper action controller."""

from collections import deque
from collections.abc import Callable
from typing import Final

from controller.action_goals import GoalStatus
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from hal.types import JointState
from servoloop.campaign.invariants.invariant import Invariant
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.grips import GripperClient, LoggedGrip

LATE_S: Final = 2.0
"""Time allowed in addition to the stall timeout, in seconds, because the fingers may be at rest when a goal starts."""
FAULT_ENDS_S: Final = 1.0
"""Maximum time until a goal ends if its joint is not measured, in seconds."""
ANSWER_CYCLES: Final = 2
"""Maximum number of cycles until a canceled or replaced goal ends."""
EARLY_CYCLES: Final = 2
"""Number of cycles by which a goal may end as stalled before its stall timeout."""
OFF_SHARE: Final = 0.03
"""Deviation allowed in addition to the goal tolerance, as a fraction of the joint's range, because of backlash."""
CREEP_SHARE: Final = 0.05
"""Maximum speed at which fingers count as at rest, in goal tolerances per second."""
FASTEST: Final = 1.05
"""Allowed speed of a command, as a multiple of the speed in its goal."""
STANDS: Final = 1e-3
"""Maximum speed of a command at rest, in rad/s or m/s."""
BRAKES_CYCLES: Final = 4
"""Number of cycles for which a moving command may gain speed and then lose it again after a goal was sent."""
STANDS_S: Final = 0.5
"""Minimum time the fingers must be at rest before a stalled goal ends, in seconds."""


class GripsAreFollowed(Invariant):
    """A gripper goal ends in time, and its result is true. A canceled or replaced goal ends immediately. A command that
    was faster before first brakes, and then does not exceed the speed in the goal.

    Positions are taken from the simulated world. Cycles in which the joint moves or is not measured do not count, but
    the goal ends after the fault timeout.
    """

    name = "gripper goals are followed"
    promised = False

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._open: dict[int, float] = {}
        """Time the joint has been measured at rest during each unfinished goal, in seconds, keyed by goal index."""
        self._unmeasured_s: dict[int, float] = {}
        """Time since the joint was last measured, in seconds, for each unfinished goal, keyed by goal index."""
        self._seen = 0
        self._speed = 0.0
        """Speed of the command in the previous cycle, in rad/s or m/s."""
        self._last_s = 0.0
        """Time of the previous cycle."""
        self._brakes_until_s = 0.0
        """Time until which the command may be faster than the speed in the latest goal, because it has to brake."""
        self._known: GripperClient | None = None
        """Client of the run. It is kept here because the stack removes its client when the program begins to end."""
        self._positions = deque[float](maxlen=max(2, round(STANDS_S / stack.loop.period_s)))

    def on_state(self, state: JointState) -> None:
        client = None if self.stack.clients is None else self.stack.clients.gripper
        if client is None:
            return
        self._known = client
        joint = client.parameters.joint
        self._positions.append(self.true_positions()[joint])
        for index in range(self._seen, len(client.goals)):
            self._open[index] = self._unmeasured_s[index] = 0.0
            self._brakes_until_s = state.stamp_s + self._brakes_s(client, client.goals[index].handle.goal.max_velocity)
        self._seen = len(client.goals)
        self._examine_speed(client, state.stamp_s)
        for index in list(self._open):
            self._examine(client, index, joint in state.faults)

    def at_end(self) -> None:
        unended = [one for one in self._known.goals if not one.handle.done] if self._known else []
        if unended:
            self.say(f"a gripper goal sent at {unended[0].sent_s:.2f} s did not end")

    def _examine(self, client: GripperClient, index: int, faulty: bool) -> None:
        logged, joint = client.goals[index], client.parameters.joint
        self.examined += 1
        if logged.handle.done:
            del self._open[index]
            self._judge(client, logged)
            return
        now_s, period_s = self.stack.clock.now(), self.stack.loop.period_s
        ends_s = [one for one in (logged.cancel_s, self._replaced_s(client, index)) if one is not None]
        if ends_s and now_s - min(ends_s) > ANSWER_CYCLES * period_s:
            self.say(f"a gripper goal continues {now_s - min(ends_s):.2f} s after it was canceled or replaced")
        self._unmeasured_s[index] = self._unmeasured_s[index] + period_s if faulty else 0.0
        if faulty:
            if (lasted_s := self._unmeasured_s[index]) > FAULT_ENDS_S:
                self.say(f"a gripper goal continues although its joint was not measured for {lasted_s:.2f} s")
            return
        stands = len(self._positions) > 1 and abs(self._positions[-1] - self._positions[-2]) < self._creep(client)
        self._open[index] += period_s * stands
        if self._open[index] > self._due_s(client):
            self.say(f"a gripper goal continues although {joint} has been at rest for {self._open[index]:.1f} s")

    def _examine_speed(self, client: GripperClient, now_s: float) -> None:
        loop, place = self.stack.loop, self.commanded.index(client.parameters.joint)
        passed_s, self._last_s = max(now_s - self._last_s, loop.period_s), now_s
        self._speed = abs(loop.command[place] - loop.previous_command[place]) / passed_s
        if not client.goals or client.goals[-1].handle.done or now_s < self._brakes_until_s or self.upset:
            return
        allowed = client.goals[-1].handle.goal.max_velocity
        if allowed and self._speed > FASTEST * allowed:
            self.say(f"a gripper goal moves the command at {self._speed:.4f}, but at most {allowed:.4f} is allowed")

    def _brakes_s(self, client: GripperClient, allowed: float) -> float:
        """Return the maximum time (s) that a command needs to slow down to an allowed speed.

        A moving command may still gain speed until the goal begins.
        """
        if self._speed < STANDS:
            return 0.0
        limits, period_s = client.limits, self.stack.loop.period_s
        too_fast = max(self._speed - allowed, 0.0)
        return too_fast / limits.acceleration + 2.0 * limits.acceleration / limits.jerk + BRAKES_CYCLES * period_s

    def _creep(self, client: GripperClient) -> float:
        """Return the maximum distance that a joint at rest may move in a cycle, in rad or m."""
        return CREEP_SHARE * client.parameters.goal_tolerance * self.stack.loop.period_s

    @staticmethod
    def _replaced_s(client: GripperClient, index: int) -> float | None:
        return client.goals[index + 1].sent_s if index + 1 < len(client.goals) else None

    @staticmethod
    def _due_s(client: GripperClient) -> float:
        """Return the maximum time the fingers may be at rest before a goal ends, in seconds."""
        return client.parameters.stall_timeout + LATE_S

    def _judge(self, client: GripperClient, logged: LoggedGrip) -> None:
        """Compare the result of a goal with the joint's true position."""
        joint, handle = client.parameters.joint, logged.handle
        succeeded, flags = handle.status is GoalStatus.SUCCEEDED, handle.state
        if flags.reached_goal != succeeded or (succeeded and flags.stalled):
            reached = f"reached_goal is {flags.reached_goal} and stalled is {flags.stalled}"
            self.say(f"a gripper goal ended as {handle.status.name}, but {reached}")
        if self.deceived(joint):
            return
        slack = OFF_SHARE * (client.limits.upper - client.limits.lower)
        off = abs(self._positions[-1] - handle.goal.position)
        if succeeded and off > client.parameters.goal_tolerance + slack:
            self.say(f"a gripper goal succeeded although {joint} is {off:.4f} away from its goal")
        lasted_s = self.stack.clock.now() - logged.sent_s
        if flags.stalled and lasted_s < client.parameters.stall_timeout - EARLY_CYCLES * self.stack.loop.period_s:
            self.say(f"a gripper goal ended as stalled {lasted_s:.2f} s after it was sent")
        travel = max(self._positions) - min(self._positions)
        if flags.stalled and travel > slack:
            self.say(f"a gripper goal ended as stalled, but {joint} moved by {travel:.4f} in the last {STANDS_S} s")
