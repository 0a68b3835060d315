"""Invariants on goals: each goal is accepted or rejected correctly and ends in time, even after a cancellation."""

import math
from collections import defaultdict
from collections.abc import Callable, Mapping
from itertools import chain, pairwise
from typing import Final

import numpy as np

from controller.action_goals import NOT_RUNNING, GoalStatus
from controller.trajectory.goal import TrajectoryGoal
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from controller.trajectory.sampler import Tracking
from hal.types import JointLimits, JointState
from servoloop.api.freedrive import FREEDRIVE
from servoloop.api.stream_gate import STREAM
from servoloop.campaign.invariants.invariant import Invariant
from servoloop.campaign.invariants.reference import read_reference
from servoloop.simulation.acts import STREAM_AGE_S
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.goal_log import LoggedGoal

REST_S: Final = 1.5
"""Maximum time until the joints are at rest at the end of a goal, in seconds."""
FAULT_ENDS_S: Final = 1.5
"""Maximum time until a goal with an unmeasured joint ends, in seconds: the fault timeout plus one second to stop."""
FAULT_STOPS_S: Final = 0.35
"""Maximum time for which a goal with an unmeasured joint continues on its path, in seconds, plus two cycles."""
GUIDED_CYCLES: Final = 4
"""Maximum number of cycles until freedrive ends after its program has lost control of the arm."""
BRAKES_S: Final = 0.2
"""Maximum time until a canceled goal leaves its path, in seconds."""
RELIEF_S: Final = 6.0
"""Maximum time until a goal that is being stopped ends, in seconds, even if its joints are blocked and must be
relieved."""
LATE_CYCLES: Final = 4
"""Maximum number of cycles for which a goal continues after its goal time tolerance has elapsed."""
BEYOND: Final = 0.01
"""Margin around a limit in which a goal may be either accepted or rejected, as a fraction of the joint's range."""
RESTS: Final = 0.02
"""Maximum velocity at which a reference counts as at rest, as a fraction of the velocity limit."""
SILENT_CYCLES: Final = 2
"""Maximum number of cycles until a stream ends after its latest target has become too old."""


class GoalsEnd(Invariant):
    """Every goal ends in time.

    The time of a goal on its path is at most the sum of its points' times, the goal time tolerance and the time to come
    to rest. Joint limits may increase the times of the points. A goal may also need time before its path to wait for
    other controllers, and time after its path to stop. Cycles in which a joint is not measured do not count, but the
    goal ends after the fault timeout.

    A stream of targets over the command socket ends soon after the latest target.
    """

    name = "every goal ends"
    of_each_arm = True

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._on_path_s: dict[int, float] = defaultdict(float)
        self._off_path_s: dict[int, float] = defaultdict(float)
        self._faulty_s: dict[int, dict[str, float]] = defaultdict(dict)
        self._scaled = False
        """Whether a client has changed the speed scaling factor."""
        self._silent_cycles = 0
        """Number of cycles for which a stream has continued without new targets."""
        self._late_cycles = 0
        """Number of cycles for which all joints were measured and one was outside the goal tolerance too late."""

    def on_state(self, state: JointState) -> None:
        self._watch_stream()
        for logged in self.stack.goals.open:
            tracking = self.arm.tracking
            if logged.controller == self.arm.name and tracking is not None:
                self.examined += 1
                self._count(logged, state, tracking)

    def at_end(self) -> None:
        self.stack.goals.end_cycle()
        if self.stack.goals.open:
            self.say(f"{len(self.stack.goals.open)} of {len(self.stack.goals.goals)} goals did not end")

    def _watch_stream(self) -> None:
        clients, stream = self.stack.clients, self.stack.manager.registry.loaded.get(STREAM)
        if clients is None or clients.programs is None or stream is None or not stream.active:
            self._silent_cycles = 0
            return
        self.examined += 1
        silent_s = self.stack.clock.now() - clients.programs.last_target_s
        self._silent_cycles = self._silent_cycles + 1 if silent_s > STREAM_AGE_S else 0
        if self._silent_cycles > SILENT_CYCLES:
            self.say(f"a stream continues although its client has been silent for {silent_s:.2f} s")

    def _count(self, logged: LoggedGoal, state: JointState, tracking: Tracking) -> None:
        arm, period_s, key = self.arm, self.stack.loop.period_s, id(logged)
        faulty = self._faulty_s[key]
        self._faulty_s[key] = {j: faulty.get(j, 0.0) + period_s for j in arm.joints if j in state.faults}
        for joint, lasted_s in self._faulty_s[key].items():
            if lasted_s > FAULT_ENDS_S + 2.0 * period_s:
                self.say(f"a goal continues although {joint} has not been measured for {lasted_s:.2f} s")
            if lasted_s > FAULT_STOPS_S + 2.5 * period_s and tracking.on_goal and logged is self.newest_goal:
                self.say(f"the path continues although {joint} has not been measured for {lasted_s:.2f} s")
        if self._faulty_s[key]:
            self._late_cycles = 0
            return
        self._examine_end(logged, tracking)
        counts = self._on_path_s if tracking.on_goal else self._off_path_s
        counts[key] += period_s * self._rate(tracking)
        ends_s = RELIEF_S if key in self._on_path_s else REST_S  # A goal that waits has no joints to relieve.
        due_s = self._due_s(logged, tracking) if tracking.on_goal else self._waits_s() + ends_s
        if counts[key] > due_s:
            self.say(f"a goal sent at {logged.sent_s:.2f} s did not end within {due_s:.1f} s")

    def _rate(self, tracking: Tracking) -> float:
        """Return the rate at which time passes on a path. It is 1 if no client has changed the speed scaling factor."""
        clients = self.stack.clients
        self._scaled = self._scaled or (clients is not None and clients.speed_factor != 1.0)
        return tracking.rate if self._scaled and tracking.on_goal else 1.0

    def _examine_end(self, logged: LoggedGoal, tracking: Tracking) -> None:
        """Check that a goal whose joints stay outside the goal tolerance ends soon after its goal time tolerance."""
        late_s = tracking.elapsed_s - tracking.path.duration_s - self._goal_time_s(logged)
        self._late_cycles = self._late_cycles + 1 if late_s > 0.0 and self._misses(logged, tracking) else 0
        if tracking.on_goal and logged is self.newest_goal and self._late_cycles > LATE_CYCLES:
            self.say(f"a goal continues {late_s:.2f} s after its goal time tolerance has elapsed")

    def _misses(self, logged: LoggedGoal, tracking: Tracking) -> bool:
        """Return whether a joint is reported outside the goal tolerance."""
        asked, defaults = logged.goal.tolerances.goal, self.arm.parameters.tolerances().goal
        allowed = [asked.get(joint) or defaults.get(joint, 0.0) for joint in self.arm.joints]
        return any(0.0 < most < abs(off) for most, off in zip(allowed, tracking.error.tolist(), strict=True))

    def _goal_time_s(self, logged: LoggedGoal) -> float:
        """Return the goal time tolerance of a goal in seconds. It is infinite if there is none."""
        asked_s = logged.goal.tolerances.goal_time_s or self.arm.parameters.constraints.goal_time
        return asked_s if asked_s > 0.0 else math.inf

    def _due_s(self, logged: LoggedGoal, tracking: Tracking) -> float:
        """Return the maximum time until a goal on its path must end, in seconds."""
        if math.isinf(goal_time_s := self._goal_time_s(logged)):
            return math.inf
        limits = dict(zip(self.commanded, self.stack.loop.limits, strict=True))
        return min(longest_s(logged.goal, limits), tracking.path.duration_s) + goal_time_s + REST_S

    def _waits_s(self) -> float:
        parameters = self.arm.parameters
        return parameters.wait_for_timeout if parameters.wait_for else 0.0


class CancelsAreFollowed(Invariant):
    """A canceled goal brakes and soon ends as canceled, with the joints at rest, unless it has already ended.

    No other goal ends as canceled. Like in ros2_control, a goal that is replaced or deactivated ends as aborted.

    A program that has died no longer controls the arm.
    """

    name = "cancels are followed"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._done: set[int] = set()
        self._unowned_cycles = 0
        """Number of cycles for which freedrive has continued without a program in control."""

    def on_state(self, state: JointState) -> None:
        for logged in (*self.stack.goals.open, *self.stack.ended_goals):
            if logged.cancel_s is not None and id(logged) not in self._done:
                self._examine(logged, bool(state.faults))
        for logged in self.stack.ended_goals:
            if logged.handle.status is GoalStatus.CANCELED and logged.cancel_s is None:
                self.say(f"a goal sent at {logged.sent_s:.2f} s ended as canceled, but no client canceled it")
        clients = self.stack.clients
        if clients is not None and clients.programs is not None and (owner := clients.programs.dead_owner):
            self.say(f"{owner} has died, but it still has control of the arm")
        if clients is not None and clients.programs is not None:
            self._examine_freedrive(clients.programs.owner)

    def _examine_freedrive(self, owner: str) -> None:
        """Check that freedrive ends when no program on the command socket has control of the arm."""
        freedrive = self.stack.manager.registry.loaded.get(FREEDRIVE)
        unowned = freedrive is not None and freedrive.active and not owner
        self._unowned_cycles = self._unowned_cycles + 1 if unowned else 0
        if self._unowned_cycles > GUIDED_CYCLES:
            self.say("freedrive continues although no program has control of the arm")

    def _require_rest(self, logged: LoggedGoal) -> None:
        """Report an arm that is still moving at the end of a canceled goal, because clients start from that position.

        A goal that is canceled before it begins ends immediately, while the joints may still be relieved.
        """
        tracking = self.arm.tracking
        if logged.cancel_s is not None and logged.cancel_s - logged.sent_s < self.stack.loop.period_s:
            return
        if tracking is None or self.newest_goal is not logged:  # A newer goal ends a canceled goal immediately.
            return
        limits = np.array([self.stack.loop.limits[self.commanded.index(joint)].velocity for joint in self.arm.joints])
        moving = np.abs(tracking.reference.velocity) > RESTS * limits
        if moving.any():
            joint = self.arm.joints[int(np.flatnonzero(moving)[0])]
            self.say(f"a goal canceled at {logged.cancel_s:.2f} s has ended, but {joint} still moves")

    def _continues(self, logged: LoggedGoal) -> bool:
        """Return whether the arm is still on the path of a goal."""
        arm = next((one for one in self.stack.arms if one.name == logged.controller), None)
        return arm is not None and arm.tracking is not None and arm.tracking.on_goal

    def _examine(self, logged: LoggedGoal, faulty: bool) -> None:
        assert logged.cancel_s is not None
        self.examined += 1
        if logged.handle.done:
            self._done.add(id(logged))
            if logged.handle.status is GoalStatus.SUCCEEDED:
                self.say(f"a goal canceled at {logged.cancel_s:.2f} s continued and succeeded")
            elif logged.handle.status is GoalStatus.CANCELED and not faulty:
                self._require_rest(logged)
            return
        canceled_s = self.stack.clock.now() - logged.cancel_s
        if canceled_s > BRAKES_S and not faulty and logged is self.newest_goal and self._continues(logged):
            self.say(f"a goal canceled at {logged.cancel_s:.2f} s continues on its path")
        if canceled_s > RELIEF_S:
            self._done.add(id(logged))
            self.say(f"a goal canceled at {logged.cancel_s:.2f} s did not end within {RELIEF_S:g} s")


class GoalsAreJudged(Invariant):
    """A goal that is malformed or exceeds a limit is rejected. A goal within the limits is accepted.

    A goal for a joint outside its limits may also lie between the joint's position and the limit.
    """

    name = "goals are judged"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._reference = read_reference(stack.files, stack.narrowed)
        self._sent = self._rejected = 0
        self._stood: dict[str, list[float]] = {}
        """Positions and commands of joints with narrowed limits in the most recent cycles, in rad or m.

        While joints return to their limits, their controller waits and knows only where the joints were before. In this
        case, all positions and commands since then are included.
        """

    def on_state(self, state: JointState) -> None:
        log, answers = self.stack.goals, self.stack.stack_faults.answers
        sent, rejected = log.goals[self._sent :], log.refused[self._rejected :]
        self._sent, self._rejected = len(log.goals), len(log.refused)
        self.examined += len(answers) + len(sent) + len(rejected)
        if None in answers:
            self.say("a malformed goal, or a motion of a program without control of the arm, was accepted")
        answers.clear()
        if self.stack.clients is not None and self.stack.clients.lifecycle.half_switched:
            self.say("a strict switch with an unknown controller was carried out in part")
        for logged in sent:
            if self._incomplete(logged.goal, logged.controller):
                self.say("a goal was accepted that does not contain all joints of its controller")
            if beyond := self._beyond(logged.goal, BEYOND):
                self.say(f"a goal beyond the limits was accepted: {beyond}")
        true, commands = self.true_positions(), dict(zip(self.commanded, self.stack.loop.command.tolist(), strict=True))
        waiting = {joint for arm in self.stack.arms if arm.tracking is None for joint in arm.joints}
        for joint in self.stack.narrowed:
            stood = self._stood.get(joint, [])
            self._stood[joint] = [*(stood if joint in waiting else stood[-2:]), true[joint], commands[joint]]
        for goal, reason in rejected:
            if reason != NOT_RUNNING and self._valid(goal) and not self._beyond(goal, -BEYOND):
                self.say(f"a goal within the limits was rejected: {reason}")

    def _beyond(self, goal: TrajectoryGoal, share: float) -> str:
        """Describe the first joint for which the goal exceeds a limit by more than ``share`` of the joint's range."""
        for point in goal.points:
            for joint, position in zip(goal.joints, point.positions, strict=False):
                known = self._reference.get(joint)
                if known is None and share > 0.0 and any(joint in arm.joints for arm in self.stack.arms):
                    continue  # The reference parser cannot read the limits of this joint.
                if known is None or not math.isfinite(position):
                    return f"{joint} to {position}"
                slack = share * (known.upper - known.lower)
                stood = self._stood.get(joint, []) if share > 0.0 else []
                if not min((known.lower, *stood)) - slack <= position <= max((known.upper, *stood)) + slack:
                    return f"{joint} to {position:.4f}, but its limits are {known.lower:g} and {known.upper:g}"
        return ""

    def _incomplete(self, goal: TrajectoryGoal, controller: str = "") -> bool:
        """Return whether a goal omits joints of an arm's controller that does not allow this.

        ``controller`` is the name of the controller that received the goal, or empty if it is unknown.
        """
        return any(
            set(goal.joints) < set(arm.joints) and not arm.parameters.allow_partial_joints_goal
            for arm in self.stack.arms
            if controller in ("", arm.name)
        )

    def _valid(self, goal: TrajectoryGoal) -> bool:
        """Return whether a goal has all joints of an arm, increasing times, and finite values that end at rest."""
        n, points = len(goal.joints), goal.points
        known = any(set(goal.joints) <= set(arm.joints) and n == len(set(goal.joints)) > 0 for arm in self.stack.arms)
        complete = known and not self._incomplete(goal)
        increasing = all(one.time_from_start_s < after.time_from_start_s for one, after in pairwise(points))
        if not (complete and increasing and points and points[0].time_from_start_s >= 0.0):
            return False
        values = [values for one in points for values in (one.positions, one.velocities, one.accelerations)]
        sized = all(len(one) == n for one in values[::3]) and all(len(one) in (0, n) for one in values)
        sized = sized and not any(one.has_effort for one in points)
        return sized and all(map(math.isfinite, chain(*values))) and not any(points[-1].velocities)


def longest_s(goal: TrajectoryGoal, limits: Mapping[str, JointLimits]) -> float:
    """Return an upper bound on the duration of a goal's path within the joint limits, in seconds.

    The motion to the first point may cover the whole range of a joint.
    """
    asked_s = goal.points[-1].time_from_start_s + max(goal.delay_s, 0.0)
    first_s = max(at_most_s(limits[joint].upper - limits[joint].lower, limits[joint]) for joint in goal.joints)
    others_s = 0.0
    for one, next_one in pairwise(goal.points):
        moves = zip(goal.joints, one.positions, next_one.positions, strict=False)
        others_s += max((at_most_s(abs(b - a), limits[joint]) for joint, a, b in moves), default=0.0)
    return max(asked_s, first_s + others_s)


def at_most_s(distance: float, limit: JointLimits) -> float:
    """Return an upper bound on the time (s) that a joint takes to move a distance (rad or m) from rest to rest."""
    distance = min(distance, 2.0 * math.tau)  # The range of a joint without limits is infinite.
    return distance / limit.velocity + 2.0 * limit.velocity / limit.acceleration + 4.0 * limit.acceleration / limit.jerk
