"""Invariants on goals: each goal ends in time, with a correct result and correct feedback."""

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
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from controller.trajectory.sampler import Tracking
from hal.types import FloatArray, JointLimits, JointState
from servoloop.api.stream_gate import STREAM
from servoloop.campaign.invariants.invariant import Invariant
from servoloop.campaign.invariants.reference import read_reference
from servoloop.simulation.acts import STREAM_AGE_S
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.goal_log import LoggedGoal

REST_S: Final = 1.5
"""Time within which the joints come to rest at the end of a goal, in seconds."""
FAULT_ENDS_S: Final = 1.5
"""Time within which a goal with an unmeasured joint ends, in seconds: the fault timeout and one second to stop."""
RELIEF_S: Final = 6.0
"""Time within which a stopping goal ends, in seconds, even if its joints are blocked and must be relieved."""
OFF: Final = re.compile(r"(?:violation|seconds): (\S+) is off by ([\d.]+), allowed is ([\d.]+)")
DEVIATION: Final = 0.1
"""Deviation allowed in addition to the tolerance, in rad or m: two readings must agree, and servos overshoot."""
DEVIATES_S: Final = 0.6
"""Time within which a goal with a larger deviation ends, in seconds."""
BEYOND: Final = 0.01
"""Margin around a limit in which a goal may be accepted or rejected, as a share of the joint's range."""
SILENT_CYCLES: Final = 2
"""Number of cycles within which a stream ends after its newest target has become too old."""
HISTORY: Final = 150
"""Number of cycles before the end of a goal that are searched for a deviation.

The goal ends only once its joints are at rest and relieved.
"""


class GoalsEnd(Invariant):
    """Every goal ends in time.

    The time of a goal on its path is the sum of the time of its points, the goal time tolerance and the time to come to
    rest. Joint limits may extend the time of the points. Before and after its path a goal may wait for other
    controllers and stop. Cycles in which a joint is not measured do not count, but the goal ends after the fault
    timeout.

    A stream of targets over the command socket ends soon after its newest target.
    """

    name = "every goal ends"
    of_each_arm = True

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._on_path_s: dict[int, float] = defaultdict(float)
        self._off_path_s: dict[int, float] = defaultdict(float)
        self._faulty_s: dict[int, dict[str, float]] = defaultdict(dict)
        self._silent_cycles = 0
        """Number of cycles for which a stream has continued without targets."""

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
        if self._faulty_s[key]:
            return
        counts = self._on_path_s if tracking.on_goal else self._off_path_s
        counts[key] += period_s
        due_s = self._due_s(logged, tracking) if tracking.on_goal else self._waits_s() + RELIEF_S
        if counts[key] > due_s:
            self.say(f"a goal sent at {logged.sent_s:.2f} s did not end within {due_s:.1f} s")

    def _due_s(self, logged: LoggedGoal, tracking: Tracking) -> float:
        """Return the time within which a goal on its path must end, in seconds."""
        goal_time_s = max(logged.goal.tolerances.goal_time_s, self.arm.parameters.constraints.goal_time)
        if goal_time_s <= 0.0:
            return math.inf
        limits = dict(zip(self.commanded, self.stack.loop.limits, strict=True))
        return min(longest_s(logged.goal, limits), tracking.path.duration_s) + goal_time_s + REST_S

    def _waits_s(self) -> float:
        parameters = self.arm.parameters
        return parameters.wait_for_timeout if parameters.wait_for else 0.0


class AbortsAreTrue(Invariant):
    """A joint that is named in an abort actually deviates from its path or is actually not measured."""

    name = "aborts are true"
    of_each_arm = True

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._history: deque[tuple[dict[str, float], dict[str, float], frozenset[str]]] = deque(maxlen=HISTORY)

    def on_state(self, state: JointState) -> None:
        tracking = self.arm.tracking
        if tracking is not None:
            wanted = dict(zip(self.arm.joints, tracking.reference.position.tolist(), strict=True))
            self._history.append((wanted, self.true_positions(), frozenset(state.faults)))
        for logged in self.stack.ended_goals:
            handle = logged.handle
            if handle.status is GoalStatus.ABORTED and logged.controller == self.arm.name:
                self._examine(handle.error_code, handle.error_text)

    def _examine(self, code: int, text: str) -> None:
        found = OFF.search(text)
        if found is not None:
            self.examined += 1
            joint, off = found[1], float(found[2])
            if not self.deceived(joint) and self._largest_deviation(joint) < 0.5 * off:
                self.say(
                    f"a goal was aborted ({text}), but {joint} deviated by at most {self._largest_deviation(joint):.3f}"
                )
        elif code == ErrorCode.PATH_TOLERANCE_VIOLATED:
            self.examined += 1
            if not any(faults for _, _, faults in self._history):
                self.say(f"a goal was aborted ({text}), but every joint was measured")

    def _largest_deviation(self, joint: str) -> float:
        return max((abs(wanted[joint] - true[joint]) for wanted, true, _ in self._history), default=math.inf)


class CancelsAreFollowed(Invariant):
    """A canceled goal brakes and soon ends as canceled, unless it has already ended.

    A program that has died no longer has control of the arm.
    """

    name = "cancels are followed"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._done: set[int] = set()

    def on_state(self, state: JointState) -> None:
        for logged in (*self.stack.goals.open, *self.stack.ended_goals):
            if logged.cancel_s is not None and id(logged) not in self._done:
                self._examine(logged)
        clients = self.stack.clients
        if clients is not None and clients.programs is not None and (owner := clients.programs.dead_owner):
            self.say(f"{owner} has died, but it still owns the motion")

    def _examine(self, logged: LoggedGoal) -> None:
        assert logged.cancel_s is not None
        self.examined += 1
        if logged.handle.done:
            self._done.add(id(logged))
            if logged.handle.status is GoalStatus.SUCCEEDED:
                self.say(f"a goal canceled at {logged.cancel_s:.2f} s continued and succeeded")
        elif self.stack.clock.now() - logged.cancel_s > RELIEF_S:
            self._done.add(id(logged))
            self.say(f"a goal canceled at {logged.cancel_s:.2f} s did not end within {RELIEF_S:g} s")


class FeedbackIsTrue(Invariant):
    """Feedback contains the measurement of its cycle, the reference and their difference, and its time increases."""

    name = "feedback is true"
    of_each_arm = True

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        names = stack.loop.hardware.joints
        self._places = [names.index(joint) for joint in arm.joints]
        self._last_s = -math.inf
        self._path: Any = None
        self._elapsed_s = 0.0

    def on_state(self, state: JointState) -> None:
        tracking = self.arm.tracking
        if tracking is None or tracking.stamp_s != state.stamp_s:
            return
        self.examined += 1
        measured: FloatArray = state.position[self._places]
        if not np.array_equal(tracking.feedback_position, measured, equal_nan=True):
            self.say("the position in the feedback differs from the measurement of the cycle")
        error = tracking.reference.position - measured
        turn = np.round((error - tracking.error) / math.tau) * math.tau
        if not np.allclose(error - turn, tracking.error, atol=1e-9, equal_nan=True):
            self.say("the error in the feedback is not the reference minus the measurement")
        if tracking.stamp_s <= self._last_s:
            self.say(
                f"the time of the feedback does not increase: {tracking.stamp_s:.3f} s follows {self._last_s:.3f} s"
            )
        if tracking.path is self._path and tracking.elapsed_s < self._elapsed_s:
            self.say("the time on the path decreases")
        self._last_s, self._path, self._elapsed_s = tracking.stamp_s, tracking.path, tracking.elapsed_s


class DeviationEnds(Invariant):
    """A goal ends if a joint deviates from the path by more than its tolerance for some time.

    The deviation is measured in the simulated world. The allowed lag of a moving joint is added to its tolerance.
    """

    name = "deviation ends a goal"
    of_each_arm = True

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._off_s = defaultdict[str, float](float)
        self._reference = read_reference(stack.files)

    def on_state(self, state: JointState) -> None:
        arm, period_s = self.arm, self.stack.loop.period_s
        open_goals = [logged for logged in self.stack.goals.open if logged.controller == arm.name]
        tracking = arm.tracking
        on_path = tracking is not None and tracking.on_goal and tracking.elapsed_s < tracking.path.duration_s
        if tracking is None or not on_path or not open_goals or state.faults:
            self._off_s.clear()
            return
        true, reference = self.true_positions(), tracking.reference
        defaults, asked = arm.parameters.tolerances(), open_goals[-1].goal.tolerances.path
        for place, joint in enumerate(arm.joints):
            allowed = asked.get(joint) or defaults.path.get(joint, 0.0)
            lag = abs(float(reference.velocity[place])) * defaults.lag_time_s.get(joint, 0.0)
            if allowed <= 0.0 or self.deceived(joint):
                continue
            self.examined += 1
            off = self._deviation(joint, float(reference.position[place]), true[joint]) > allowed + lag + DEVIATION
            self._off_s[joint] = self._off_s[joint] + period_s if off else 0.0
            if self._off_s[joint] > DEVIATES_S:
                wanted = f"its reference is at {reference.position[place]:.3f}"
                self.say(f"a goal continues although {joint} is at {true[joint]:.3f} and {wanted}")

    def _deviation(self, joint: str, wanted: float, true: float) -> float:
        """Return the smallest distance between the reference and a position that the servo may report."""
        known = self._reference.get(joint)
        readings = [true] if known is None else known.readings(true, 0.0)
        return min(abs(wanted - reading) for reading in readings)


class GoalsAreJudged(Invariant):
    """A goal that is malformed or exceeds a limit is rejected. A goal within the limits is accepted."""

    name = "goals are judged"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._reference = read_reference(stack.files)
        self._sent = self._rejected = 0

    def on_state(self, state: JointState) -> None:
        log, answers = self.stack.goals, self.stack.stack_faults.answers
        sent, rejected = log.goals[self._sent :], log.refused[self._rejected :]
        self._sent, self._rejected = len(log.goals), len(log.refused)
        self.examined += len(answers) + len(sent) + len(rejected)
        if None in answers:
            self.say("a malformed goal was accepted")
        answers.clear()
        for logged in sent:
            if beyond := self._beyond(logged.goal, BEYOND):
                self.say(f"a goal beyond the limits was accepted: {beyond}")
        for goal, reason in rejected:
            if len(goal.points) == 1 and not self._beyond(goal, -BEYOND) and self._complete(goal, reason):
                self.say(f"a goal within the limits was rejected: {reason}")

    def _beyond(self, goal: TrajectoryGoal, share: float) -> str:
        """Describe the first joint that the goal commands beyond a limit by more than ``share`` of its range."""
        for point in goal.points:
            for joint, position in zip(goal.joints, point.positions, strict=False):
                known = self._reference.get(joint)
                if known is None and share > 0.0 and any(joint in arm.joints for arm in self.stack.arms):
                    continue  # The reference reader cannot read its limits.
                if known is None or not math.isfinite(position):
                    return f"{joint} to {position}"
                slack = share * (known.upper - known.lower)
                if not known.lower - slack <= position <= known.upper + slack:
                    return f"{joint} to {position:.4f}, but its limits are {known.lower:g} and {known.upper:g}"
        return ""

    def _complete(self, goal: TrajectoryGoal, reason: str) -> bool:
        whole = any(set(goal.joints) == set(arm.joints) for arm in self.stack.arms)
        return whole and len(goal.points[0].positions) == len(goal.joints) and reason != NOT_RUNNING


def longest_s(goal: TrajectoryGoal, limits: Mapping[str, JointLimits]) -> float:
    """Return an upper bound of the duration of a goal's path within the joint limits, in seconds.

    The motion to the first point may cover the whole range of a joint.
    """
    asked_s = goal.points[-1].time_from_start_s + max(goal.delay_s, 0.0)
    first_s = max(_duration_s(limits[joint].upper - limits[joint].lower, limits[joint]) for joint in goal.joints)
    others_s = 0.0
    for one, next_one in pairwise(goal.points):
        moves = zip(goal.joints, one.positions, next_one.positions, strict=False)
        others_s += max((_duration_s(abs(b - a), limits[joint]) for joint, a, b in moves), default=0.0)
    return max(asked_s, first_s + others_s)


def _duration_s(distance: float, limit: JointLimits) -> float:
    """Return an upper bound of the time (s) that a joint takes from rest to rest over a distance (rad or m)."""
    distance = min(distance, 2.0 * math.tau)  # The range of a joint without limits is infinite.
    return distance / limit.velocity + 2.0 * limit.velocity / limit.acceleration + 4.0 * limit.acceleration / limit.jerk
