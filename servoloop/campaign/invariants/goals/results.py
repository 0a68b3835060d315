"""Invariants on the result and the feedback of a goal: both agree with the actual motion."""

import math
import re
from collections import defaultdict, deque
from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from controller.action_goals import GoalStatus
from controller.trajectory.goal_result import ErrorCode
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from controller.trajectory.sampler import Tracking
from hal.types import FloatArray, JointState
from servoloop.campaign.invariants.invariant import Invariant
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.goal_log import LoggedGoal

OFF: Final = re.compile(r"(?:violation|seconds): (\S+) is off by ([\d.]+), allowed is ([\d.]+)")
LATE: Final = re.compile(r"goal_time_tolerance exceeding by ([\d.]+) seconds")
CODES: Final = {
    "path tolerance": ErrorCode.PATH_TOLERANCE_VIOLATED,
    "goal_time_tolerance": ErrorCode.GOAL_TOLERANCE_VIOLATED,
}
"""Error code that belongs to a message with these words."""
DEVIATION: Final = 0.1
"""Deviation allowed in addition to the tolerance, in rad or m, because two readings must agree and servos overshoot."""
DEVIATES_S: Final = 0.6
"""Maximum time until a goal ends if its deviation exceeds the tolerance by more than ``DEVIATION``, in seconds."""
OWN_S: Final = 0.4
"""Maximum time until a goal ends if a reported position deviates by more than the goal's tolerance, in seconds."""
ROUNDING: Final = 1e-9
"""Tolerance for rounding, in rad or m."""
READING: Final = 0.003
"""Deviation of a reported position allowed in addition to the goal's own tolerance, in rad or m."""
REPORTED: Final = 0.002
"""Deviation of a reported position allowed in addition to the goal tolerance, in rad or m."""
ARRIVED: Final = 0.02
"""Deviation allowed in addition to the goal tolerance, in rad or m, because the stack checks a servo reading against
the tolerance."""
RESTS_SHARE: Final = 0.05
"""Maximum speed of a joint at rest, as a fraction of its velocity limit. This limit allows a slow oscillation."""
OSCILLATES_S: Final = 0.9
"""Time after the end of a path from which a goal may succeed although its joints move, in seconds."""
TOUCHED_S: Final = 1.0
"""Time after a fault of a joint during which the joints of the arm may move, in seconds."""
ABORTS_CYCLES: Final = 7
"""Minimum number of consecutive cycles without a measurement after which a goal is aborted."""
STALLED_CYCLES: Final = 3.0
"""Duration above which a cycle counts as one in which the computer stalled, in periods."""
HISTORY: Final = 150
"""Number of cycles before the end of a goal in which to search for a deviation.

The goal ends only after its joints are at rest and relieved.
"""


class _Cycle(NamedTuple):
    """What an arm did in one cycle. Positions are in rad or m, keyed by joint name."""

    wanted: dict[str, float]
    true: dict[str, float]
    unmeasured_cycles: int
    """Largest number of consecutive cycles up to this cycle in which a joint of the arm was not measured."""
    on_goal: bool


class AbortsAreTrue(Invariant):
    """A joint named in the abort message has really deviated from its path or could not be measured.

    The error code of a result agrees with its status and its message. If the arm has no fault, a goal that follows its
    path is aborted only if another goal replaces it or its controller becomes inactive.
    """

    name = "aborts are true"
    of_each_arm = True

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._history: deque[_Cycle] = deque(maxlen=HISTORY)
        self._unmeasured: dict[str, int] = {}
        """Number of cycles for which each joint of the arm has not been measured."""
        self._followed: LoggedGoal | None = None
        """Goal whose path the arm has followed."""

    def on_state(self, state: JointState) -> None:
        tracking = self.arm.tracking
        self._unmeasured = {one: self._unmeasured.get(one, 0) + 1 for one in self.arm.joints if one in state.faults}
        if tracking is not None:
            wanted = dict(zip(self.arm.joints, tracking.reference.position.tolist(), strict=True))
            unmeasured_cycles = max(self._unmeasured.values(), default=0)
            self._history.append(_Cycle(wanted, self.true_positions(), unmeasured_cycles, tracking.on_goal))
        for logged in self.stack.ended_goals:
            handle = logged.handle
            if logged.controller != self.arm.name:
                continue
            aborted = handle.status is GoalStatus.ABORTED
            if aborted:
                self._examine(logged, handle.error_code, handle.error_text)
                self._examine_reason(logged)
                self._examine_time(logged)
            if aborted != (handle.error_code != ErrorCode.SUCCESSFUL) or not _belongs(
                handle.error_code, handle.error_text
            ):
                result = f"{handle.status.name} with the error code {handle.error_code}"
                self.say(f"the result of a goal is {result}: {handle.error_text}")
        if tracking is not None and tracking.on_goal:
            self._followed = self.newest_goal

    def _examine(self, logged: LoggedGoal, code: int, text: str) -> None:
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
            if (cycles := self._cycles_unmeasured(logged is self._followed)) < ABORTS_CYCLES:
                self.say(f"a goal was aborted ({text}), but no joint missed more than {cycles} measurements in a row")

    def _examine_reason(self, logged: LoggedGoal) -> None:
        """Check that a goal without an error of the arm was replaced, or that its controller is inactive."""
        if logged.handle.error_code != ErrorCode.INVALID_GOAL or logged is not self._followed:
            return
        self.examined += 1
        active = self.stack.manager.registry.loaded[self.arm.name].active
        if active and self.active and not self.stack.ending and logged is self.newest_goal:
            self.say(f"a goal was aborted without a reason: {logged.handle.error_text}")

    def _examine_time(self, logged: LoggedGoal) -> None:
        """Check that a goal that ended too late had exceeded its own goal time tolerance."""
        found = LATE.search(logged.handle.error_text)
        if found is None:
            return
        self.examined += 1
        allowed_s = logged.goal.tolerances.goal_time_s or self.arm.parameters.constraints.goal_time
        if float(found[1]) < allowed_s:
            self.say(f"a goal with a goal time tolerance of {allowed_s:g} s was aborted after {found[1]} s")

    def _cycles_unmeasured(self, followed: bool) -> int:
        """Return the largest number of consecutive cycles in which a joint of the arm was not measured.

        If the arm has followed the path of the goal, only the cycle in which it left this path counts.
        """
        on_path = [number for number, one in enumerate(self._history) if one.on_goal and followed]
        left = on_path[-1] if on_path else None
        counted = (one for number, one in enumerate(self._history) if left is None or abs(number - left) <= 1)
        return max((one.unmeasured_cycles for one in counted), default=0)

    def _largest_deviation(self, joint: str) -> float:
        off = (
            abs(one.wanted[joint] - reading)
            for one in self._history
            for reading in self.readings(joint, one.true[joint])
        )
        return max(off, default=math.inf)


def _belongs(code: int, text: str) -> bool:
    """Return whether the error code agrees with the kind of tolerance that the message names, if any."""
    return next((code == own for words, own in CODES.items() if words in text), True)


class FeedbackIsTrue(Invariant):
    """Feedback contains the measurement of its cycle, the reference and the difference between them, and its time
    increases."""

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
        if tracking.feedback_position.tobytes() != measured.tobytes():
            self.say("the position in the feedback differs from the measurement of the cycle")
        if tracking.feedback_velocity.tobytes() != state.velocity[self._places].tobytes():
            self.say("the velocity in the feedback differs from the measurement of the cycle")
        error = tracking.reference.position - measured
        turn = np.round((error - tracking.error) / math.tau) * math.tau
        apart = np.abs(error - turn - tracking.error)
        if (apart > ROUNDING).any() or (np.isnan(apart) & ~(np.isnan(error) & np.isnan(tracking.error))).any():
            self.say("the error in the feedback is not the reference minus the measurement")
        if tracking.stamp_s <= self._last_s:
            self.say(
                f"the time of the feedback does not increase: {tracking.stamp_s:.3f} s follows {self._last_s:.3f} s"
            )
        if tracking.path is self._path and tracking.elapsed_s < self._elapsed_s:
            self.say("the time on the path decreases")
        self._last_s, self._path, self._elapsed_s = tracking.stamp_s, tracking.path, tracking.elapsed_s


class DeviationEnds(Invariant):
    """A goal ends if a joint deviates from the path by more than its tolerance for too long.

    The deviation is measured in the simulated world. The allowed lag of a moving joint is added to its tolerance.
    Tolerances set by a client may be small, so they are compared with the reported positions.
    """

    name = "deviation ends a goal"
    of_each_arm = True

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._off_s = defaultdict[str, float](float)
        self._own_s = defaultdict[str, float](float)
        """Time that the reported position has been outside the goal's own tolerance, in seconds, keyed by joint
        name."""

    def on_state(self, state: JointState) -> None:
        arm, period_s = self.arm, self.stack.loop.period_s
        open_goals = [logged for logged in self.stack.goals.open if logged.controller == arm.name]
        tracking = arm.tracking
        on_path = tracking is not None and tracking.on_goal and tracking.elapsed_s < tracking.path.duration_s
        if tracking is None or not on_path or not open_goals or state.faults.keys() & set(arm.joints):
            self._off_s.clear()
            self._own_s.clear()
            return
        reported = self.reported_positions(state)
        true, reference = self.true_positions(), tracking.reference
        defaults, asked = arm.parameters.tolerances(), open_goals[-1].goal.tolerances.path
        for place, joint in enumerate(arm.joints):
            allowed = asked.get(joint) or defaults.path.get(joint, 0.0)
            lag_s = 0.0 if asked.get(joint) else defaults.lag_time_s.get(joint, 0.0)
            lag = abs(float(reference.velocity[place])) * lag_s
            if asked.get(joint):
                self._examine_own(joint, float(reference.position[place]) - reported[joint], asked[joint])
            if allowed <= 0.0 or self.deceived(joint):
                continue
            self.examined += 1
            off = self._deviation(joint, float(reference.position[place]), true[joint]) > allowed + lag + DEVIATION
            self._off_s[joint] = self._off_s[joint] + period_s if off else 0.0
            if self._off_s[joint] > DEVIATES_S:
                wanted = f"its reference is at {reference.position[place]:.3f}"
                self.say(f"a goal continues although {joint} is at {true[joint]:.3f} and {wanted}")

    def _examine_own(self, joint: str, off: float, allowed: float) -> None:
        """Compare a reported deviation with a tolerance of the goal."""
        period_s = self.stack.loop.period_s
        self._own_s[joint] = self._own_s[joint] + period_s if abs(off) > allowed + READING else 0.0
        if self._own_s[joint] > OWN_S:
            self.say(f"a goal continues although {joint} is reported {abs(off):.3f} off its path ({allowed} allowed)")

    def _deviation(self, joint: str, wanted: float, true: float) -> float:
        """Return the smallest distance between the reference and a position that the servo may report."""
        return min(abs(wanted - reading) for reading in self.readings(joint, true))


class SuccessIsTrue(Invariant):
    """When a goal succeeds, its joints are reported to be within the goal tolerance of the positions that the client
    sent.

    In the simulated world, the joints are near these positions and at rest, unless the computer stalled between the
    measurement and the result.
    """

    name = "success is true"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._before = stack.world.position()
        """True positions in the previous cycle."""
        self._last_s = stack.clock.now()
        """Time of the previous cycle."""
        self._stalled = False
        """Whether the computer stalled in this cycle."""

    def on_state(self, state: JointState) -> None:
        now_s = self.stack.clock.now()
        self._stalled, self._last_s = now_s - self._last_s > STALLED_CYCLES * self.stack.loop.period_s, now_s
        for logged in self.stack.ended_goals:
            if logged.handle.status is GoalStatus.SUCCEEDED:
                self._arrived(logged, state)
                self._examine_measured(logged, state)
                for arm in self.stack.arms:
                    if arm.name == logged.controller and not _oscillates(arm.tracking):
                        self._examine_rest(arm.joints, state)
        self._before = self.stack.world.position()

    def _examine_measured(self, logged: LoggedGoal, state: JointState) -> None:
        """Check that all joints of a successful goal were measured."""
        self.examined += 1
        if unmeasured := state.faults.keys() & set(logged.goal.joints):
            self.say(f"a goal succeeded although {', '.join(sorted(unmeasured))} was not measured")

    def _examine_rest(self, joints: Sequence[str], state: JointState) -> None:
        """Check the velocities of an arm. A joint that was at the same position one cycle ago may oscillate faster than
        the stack can measure."""
        world, period_s = self.stack.world, self.stack.loop.period_s
        if min(map(self.stack.touches.since_s, joints)) < TOUCHED_S:
            return  # A joint that is released moves its neighbors.
        mean = (world.position() - self._before) / period_s
        speed = np.minimum(np.abs(world.velocity()), np.abs(mean))
        speeds = dict(zip(world.joints, speed.tolist(), strict=True))
        for joint in joints:
            if joint in state.faults or self.deceived(joint):
                continue
            self.examined += 1
            if speeds[joint] > RESTS_SHARE * self.stack.loop.limits[self.commanded.index(joint)].velocity:
                self.say(f"a goal succeeded while {joint} still moved at {speeds[joint]:.3f}")

    def _arrived(self, logged: LoggedGoal, state: JointState) -> None:
        tolerances = self.stack.controllers[logged.controller].parameters.tolerances().goal
        asked = logged.goal.tolerances.goal
        true, last = self.true_positions(), logged.goal.points[-1]
        reported = self.reported_positions(state)
        for joint, wanted in zip(logged.goal.joints, last.positions, strict=False):
            allowed = asked.get(joint) or tolerances.get(joint, 0.0)
            if allowed <= 0.0 or joint not in true or self.deceived(joint):
                continue
            self.examined += 1
            wanted = self.end_of_goal(joint, wanted)
            if abs(true[joint] - wanted) > allowed + ARRIVED and not self._stalled:
                self.say(f"a goal succeeded with {joint} at {true[joint]:.4f}, but its client sent it to {wanted:.4f}")
            if abs(reported[joint] - wanted) > allowed + REPORTED and joint not in state.faults:
                self.say(f"a goal succeeded with {joint} reported at {reported[joint]:.4f} instead of {wanted:.4f}")


def _oscillates(tracking: Tracking | None) -> bool:
    """Return whether a goal may succeed although its joints move. It waits one second for joints that oscillate."""
    return tracking is None or tracking.elapsed_s - tracking.path.duration_s > OSCILLATES_S
