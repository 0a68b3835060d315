"""What must hold of the goals of trajectory controllers: each client gets the end that it was promised, in time."""

import math
import re
from collections import defaultdict, deque
from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import Any, Final

import numpy as np

from controller.action_goals import NOT_RUNNING, GoalStatus
from controller.trajectory.goal import TrajectoryGoal
from controller.trajectory.goal_result import ErrorCode
from controller.trajectory.sampler import Tracking
from hal.types import FloatArray, JointLimits, JointState
from servoloop.campaign.invariants.invariant import Invariant
from servoloop.campaign.invariants.reference import read_reference
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.goal_log import LoggedGoal

REST_S: Final = 1.5
"""Time in which joints come to rest at the end of a goal."""
FAULT_ENDS_S: Final = 1.5
"""Time in which a goal ends whose joint is not measured: the fault timeout, and one second to come to rest."""
RELIEF_S: Final = 6.0
"""Time in which a goal that stops ends although something holds its joints, so that each of them is relieved."""
OFF: Final = re.compile(r"(?:violation|seconds): (\S+) is off by ([\d.]+), allowed is ([\d.]+)")
DEVIATION: Final = 0.1
"""rad or m by which a joint may be further off than its tolerance: two readings have to agree, and servos overshoot."""
DEVIATES_S: Final = 0.6
"""Time in which such a goal ends."""
BEYOND: Final = 0.01
"""Share of a joint's range within which a position counts as being at its limit."""
HISTORY: Final = 44
"""Cycles before the end of a goal in which a deviation is looked for: the goal ends once its joints rest."""


class GoalsEnd(Invariant):
    """Every goal has an end, and in time.

    On its path a goal has the time of its points, or longer if the joints' limits stretch it, then the goal time
    tolerance and the time in which joints come to rest. Before and after that it may wait for other controllers, and
    stop. Cycles in which a joint is not measured do not count; a goal whose joint is not measured for longer than the
    fault timeout ends then.
    """

    name = "every goal ends"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None]) -> None:
        super().__init__(stack, say)
        self._on_path_s: dict[int, float] = defaultdict(float)
        self._beside_s: dict[int, float] = defaultdict(float)
        self._faulty_s: dict[int, dict[str, float]] = defaultdict(dict)

    def on_state(self, state: JointState) -> None:
        for logged in self.stack.goals.open:
            tracking = self.stack.arm.tracking
            if logged.controller == self.stack.arm.name and tracking is not None:
                self.examined += 1
                self._count(logged, state, tracking)

    def at_end(self) -> None:
        self.stack.goals.end_cycle()
        if self.stack.goals.open:
            self.say(f"{len(self.stack.goals.open)} of {len(self.stack.goals.goals)} goals have no end")

    def _count(self, logged: LoggedGoal, state: JointState, tracking: Tracking) -> None:
        arm, period_s, key = self.stack.arm, self.stack.loop.period_s, id(logged)
        faulty = self._faulty_s[key]
        self._faulty_s[key] = {j: faulty.get(j, 0.0) + period_s for j in arm.joints if j in state.faults}
        for joint, lasted_s in self._faulty_s[key].items():
            if lasted_s > FAULT_ENDS_S + 2.0 * period_s:
                self.say(f"a goal goes on, and {joint} has not been measured for {lasted_s:.2f} s")
        if self._faulty_s[key]:
            return
        counts = self._on_path_s if tracking.on_goal else self._beside_s
        counts[key] += period_s
        due_s = self._due_s(logged, tracking) if tracking.on_goal else self._waits_s() + RELIEF_S
        if counts[key] > due_s:
            self.say(f"a goal sent at {logged.sent_s:.2f} s has no end after {due_s:.1f} s")

    def _due_s(self, logged: LoggedGoal, tracking: Tracking) -> float:
        """Time in which a goal on its path has to end, by its own points and by its path, s."""
        goal_time_s = max(logged.goal.tolerances.goal_time_s, self.stack.arm.parameters.constraints.goal_time)
        if goal_time_s <= 0.0:
            return math.inf
        limits = dict(zip(self.commanded, self.stack.loop.limits, strict=True))
        return min(longest_s(logged.goal, limits), tracking.path.duration_s) + goal_time_s + REST_S

    def _waits_s(self) -> float:
        parameters = self.stack.arm.parameters
        return parameters.wait_for_timeout if parameters.wait_for else 0.0


class AbortsAreTrue(Invariant):
    """A goal that is aborted names a joint that is really off, or one that is really not measured."""

    name = "aborts are true"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None]) -> None:
        super().__init__(stack, say)
        self._history: deque[tuple[dict[str, float], dict[str, float], frozenset[str]]] = deque(maxlen=HISTORY)

    def on_state(self, state: JointState) -> None:
        tracking = self.stack.arm.tracking
        if tracking is not None:
            wanted = dict(zip(self.stack.arm.joints, tracking.reference.position.tolist(), strict=True))
            self._history.append((wanted, self.true_positions(), frozenset(state.faults)))
        for logged in self.stack.ended_goals:
            handle = logged.handle
            if handle.status is GoalStatus.ABORTED and logged.controller == self.stack.arm.name:
                self._judge(handle.error_code, handle.error_text)

    def _judge(self, code: int, text: str) -> None:
        found = OFF.search(text)
        if found is not None:
            self.examined += 1
            joint, off = found[1], float(found[2])
            if not self.deceived(joint) and self._largest(joint) < 0.5 * off:
                self.say(f"a goal was aborted: {text}; {joint} was off by {self._largest(joint):.3f} at most")
        elif code == ErrorCode.PATH_TOLERANCE_VIOLATED:
            self.examined += 1
            if not any(faults for _, _, faults in self._history):
                self.say(f"a goal was aborted: {text}; every joint was measured")

    def _largest(self, joint: str) -> float:
        return max((abs(wanted[joint] - true[joint]) for wanted, true, _ in self._history), default=math.inf)


class CancelsAreFollowed(Invariant):
    """A goal that its client cancels ends as canceled, unless it had ended; soon, and having only braked."""

    name = "cancels are followed"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None]) -> None:
        super().__init__(stack, say)
        self._judged: set[int] = set()

    def on_state(self, state: JointState) -> None:
        for logged in (*self.stack.goals.open, *self.stack.ended_goals):
            if logged.cancel_s is not None and id(logged) not in self._judged:
                self._judge(logged, state)

    def _judge(self, logged: LoggedGoal, state: JointState) -> None:
        assert logged.cancel_s is not None
        self.examined += 1
        if logged.handle.done:
            self._judged.add(id(logged))
            if logged.handle.status is GoalStatus.SUCCEEDED:
                self.say(f"a goal canceled at {logged.cancel_s:.2f} s goes on to its end and succeeds")
        elif self.stack.clock.now() - logged.cancel_s > RELIEF_S:
            self._judged.add(id(logged))
            self.say(f"a goal canceled at {logged.cancel_s:.2f} s has no end after {RELIEF_S:g} s")


class FeedbackIsTrue(Invariant):
    """A controller's feedback has the measurement of its cycle, the reference, and their difference; time goes on."""

    name = "feedback is true"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None]) -> None:
        super().__init__(stack, say)
        names = stack.loop.hardware.joints
        self._places = [names.index(joint) for joint in stack.arm.joints]
        self._last_s = -math.inf
        self._path: Any = None
        self._elapsed_s = 0.0

    def on_state(self, state: JointState) -> None:
        tracking = self.stack.arm.tracking
        if tracking is None or tracking.stamp_s != state.stamp_s:
            return
        self.examined += 1
        measured: FloatArray = state.position[self._places]
        if not np.array_equal(tracking.feedback_position, measured, equal_nan=True):
            self.say("the feedback has another position than the cycle's measurement")
        error = tracking.reference.position - measured
        turn = np.round((error - tracking.error) / math.tau) * math.tau
        if not np.allclose(error - turn, tracking.error, atol=1e-9, equal_nan=True):
            self.say("the error in the feedback is not the reference less the measurement")
        if tracking.stamp_s <= self._last_s:
            self.say(f"the time of the feedback does not go on: {tracking.stamp_s:.3f} s after {self._last_s:.3f} s")
        if tracking.path is self._path and tracking.elapsed_s < self._elapsed_s:
            self.say("the time on the path goes back")
        self._last_s, self._path, self._elapsed_s = tracking.stamp_s, tracking.path, tracking.elapsed_s


class DeviationEnds(Invariant):
    """A goal ends when a joint is further off its path than its tolerance, and stays there.

    The joint's place is that of the simulated world. A tolerance counts with what a moving joint may lag.
    """

    name = "deviation ends a goal"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None]) -> None:
        super().__init__(stack, say)
        self._off_s = defaultdict[str, float](float)

    def on_state(self, state: JointState) -> None:
        arm, period_s = self.stack.arm, self.stack.loop.period_s
        open_ones = [logged for logged in self.stack.goals.open if logged.controller == arm.name]
        tracking = arm.tracking
        on_path = tracking is not None and tracking.on_goal and tracking.elapsed_s < tracking.path.duration_s
        if tracking is None or not on_path or not open_ones or state.faults:
            self._off_s.clear()
            return
        true, reference = self.true_positions(), tracking.reference
        defaults, asked = arm.parameters.tolerances(), open_ones[-1].goal.tolerances.path
        for place, joint in enumerate(arm.joints):
            allowed = asked.get(joint) or defaults.path.get(joint, 0.0)
            lag = abs(float(reference.velocity[place])) * defaults.lag_time_s.get(joint, 0.0)
            if allowed <= 0.0 or self.deceived(joint):
                continue
            self.examined += 1
            off = abs(float(reference.position[place]) - true[joint]) > allowed + lag + DEVIATION
            self._off_s[joint] = self._off_s[joint] + period_s if off else 0.0
            if self._off_s[joint] > DEVIATES_S:
                wanted = f"its reference is {reference.position[place]:.3f}"
                self.say(f"a goal goes on with {joint} at {true[joint]:.3f}; {wanted}")


class GoalsAreJudged(Invariant):
    """A goal that makes no sense or leads beyond a limit is refused; one within the limits is taken."""

    name = "goals are judged"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None]) -> None:
        super().__init__(stack, say)
        self._reference = read_reference(stack.files)
        self._sent = self._refused = 0

    def on_state(self, state: JointState) -> None:
        log, answers = self.stack.goals, self.stack.stack_faults.answers
        sent, refused = log.goals[self._sent :], log.refused[self._refused :]
        self._sent, self._refused = len(log.goals), len(log.refused)
        self.examined += len(answers) + len(sent) + len(refused)
        if None in answers:
            self.say("a goal that makes no sense was taken")
        answers.clear()
        for logged in sent:
            if beyond := self._beyond(logged.goal, BEYOND):
                self.say(f"a goal was taken that sends {beyond}")
        for goal, reason in refused:
            if len(goal.points) == 1 and not self._beyond(goal, -BEYOND) and self._sensible(goal, reason):
                self.say(f"a goal within the limits was refused: {reason}")

    def _beyond(self, goal: TrajectoryGoal, share: float) -> str:
        """The joint that is sent beyond a limit by more than this share of its range."""
        for point in goal.points:
            for joint, position in zip(goal.joints, point.positions, strict=False):
                known = self._reference.get(joint)
                if known is None and joint in self.stack.arm.joints and share > 0.0:
                    continue  # its limits are no plain numbers
                if known is None or not math.isfinite(position):
                    return f"{joint} to {position}"
                slack = share * (known.upper - known.lower)
                if not known.lower - slack <= position <= known.upper + slack:
                    return f"{joint} to {position:.4f}, its limits are {known.lower:g} and {known.upper:g}"
        return ""

    def _sensible(self, goal: TrajectoryGoal, reason: str) -> bool:
        whole = set(goal.joints) == set(self.stack.arm.joints) and len(goal.points[0].positions) == len(goal.joints)
        return whole and reason != NOT_RUNNING


def longest_s(goal: TrajectoryGoal, limits: Mapping[str, JointLimits]) -> float:
    """An upper bound of the time (s) that a goal's path takes, however the joints' limits stretch it.

    The way to the first point may lead through the whole range of a joint.
    """
    asked_s = goal.points[-1].time_from_start_s + max(goal.delay_s, 0.0)
    first_s = max(_way_s(limits[joint].upper - limits[joint].lower, limits[joint]) for joint in goal.joints)
    others_s = 0.0
    for one, next_one in pairwise(goal.points):
        ways = zip(goal.joints, one.positions, next_one.positions, strict=False)
        others_s += max((_way_s(abs(b - a), limits[joint]) for joint, a, b in ways), default=0.0)
    return max(asked_s, first_s + others_s)


def _way_s(way: float, limit: JointLimits) -> float:
    """Time (s) that a joint takes from rest to rest over a way (rad or m), with room to spare."""
    way = min(way, 2.0 * math.tau)  # of a joint without ends
    return way / limit.velocity + 2.0 * limit.velocity / limit.acceleration + 4.0 * limit.acceleration / limit.jerk
