"""Execute a trajectory controller's goals one after another, each from its start to its result."""

import logging
from collections import deque
from collections.abc import Sequence
from typing import Final

from controller.action_goals import DEACTIVATED, PREEMPTED, GoalStatus
from controller.interface import Settled
from controller.motion import Path, stretched
from controller.trajectory.active_goal import ActiveGoal, Cycle, commands_timed_out
from controller.trajectory.goal import GoalHandle, TrajectoryGoal
from controller.trajectory.goal_planner import Plan
from controller.trajectory.goal_result import (
    CANCELED,
    PREEMPTED_BY_TOPIC,
    TIMED_OUT,
    ErrorCode,
    GoalResult,
    cannot_begin,
    result_at_end,
)
from controller.trajectory.relief import Relief
from controller.trajectory.sampler import TrajectorySampler
from controller.trajectory.stretch_log import StretchLog
from controller.trajectory.tolerances import Tolerances, excess, resolve
from hal.fault_timeout import FaultTimeout

LOG = logging.getLogger("servoloop.controller")

LATE_S: Final = 0.001
"""Minimum delay of the first cycle at which the controller replans the motion to the first point, in seconds."""
RECALL_S: Final = 0.05
"""Maximum time after its start at which a goal can still be put back into the waiting state, in seconds. If a cycle is
longer, one cycle is used instead.

A command sent to another controller at the same time as the goal may arrive just after the goal. The arm has hardly
moved by then.
"""


class GoalExecution:
    """Executor of a controller's goals.

    Any thread may call ``submit`` and ``cancel``, which take effect in the next cycle.
    """

    def __init__(self, name: str, joints: Sequence[str], sampler: TrajectorySampler, settled: Settled) -> None:
        self._name = name
        self._joints = tuple(joints)
        self._sampler = sampler
        self._relief = Relief(name, joints, sampler)
        self._stretches = StretchLog(name)
        self._unmeasured = FaultTimeout(self._joints)
        """Fault timeout for joints that are being relieved without a goal."""
        self._others_settled = settled
        self._inbox: deque[tuple[GoalHandle, Plan]] = deque()
        self._cancels: deque[GoalHandle] = deque()
        self.active: ActiveGoal | None = None
        self.newest: GoalHandle | None = None
        """The latest goal: queued, active or finished."""

    def submit(self, handle: GoalHandle, plan: Plan) -> None:
        """Queue a goal that replaces the active goal."""
        self._inbox.append((handle, plan))
        self.newest = handle

    def cancel(self, handle: GoalHandle) -> None:
        """Cancel a goal if it is still active in the next cycle."""
        self._cancels.append(handle)

    @property
    def idle(self) -> bool:
        """Whether no goals are active or queued."""
        return self.active is None and not self._inbox

    def end(self, reason: str = "") -> None:
        """Abort all goals, because the controller is being deactivated. ``reason`` is added to the result text."""
        text = f"{DEACTIVATED} {reason}".rstrip()
        if self.active:
            self._end(self.active, GoalResult(GoalStatus.ABORTED, ErrorCode.INVALID_GOAL, text))
        self._relief.due = False
        self._cancels.clear()
        while self._inbox:
            self._inbox.popleft()[0].decide(GoalStatus.ABORTED, ErrorCode.INVALID_GOAL, text)

    def begin_relief(self) -> None:
        """Start the relief of an inactive controller whose joints are at rest."""
        self._relief.begin()
        self._unmeasured = FaultTimeout(self._joints)

    def relieve(self, now: Cycle) -> bool:
        """Run one cycle of the relief. Return whether another cycle is needed.

        The relief ends early only if no joint is measured. Neighbors of a silent joint may be pressing against an
        obstacle, and a limp joint is still measured.
        """
        faults = now.state.faults
        unmeasured = {name: fault for name, fault in faults.items() if fault.kind != "no_torque"}
        if self._unmeasured.lasting(unmeasured, now.period_s) and unmeasured.keys() >= set(self._joints):
            return False
        self._relief.step(now)
        return self._relief.goes_on

    def cycle(self, now: Cycle) -> None:
        """Process cancel requests, new goals and the active goal."""
        self._take_cancels(now)
        self._take_goals(now)
        if self._relief.due:
            self._relief.step(now)
        if self.active:
            self._go_on(self.active, now)
        if now.parameters.cmd_timeout and commands_timed_out(self._sampler, now.parameters):
            if self.active:
                self._finish(self.active, TIMED_OUT, now)
            else:
                self._halt(now)

    def _take_cancels(self, now: Cycle) -> None:
        while self._cancels:
            handle = self._cancels.popleft()
            self._replace_by(handle, now)
            if self.active and self.active.handle is handle and now.parameters.constraints.decelerate_on_cancel:
                if not self.active.ending:
                    self._finish(self.active, CANCELED, now)
                continue
            if self.active and self.active.handle is handle:
                self._halt(now)
            # The copy is needed because other threads may append goals at the same time.
            for waiting in [entry for entry in tuple(self._inbox) if entry[0] is handle]:
                self._inbox.remove(waiting)
            handle.decide(GoalStatus.CANCELED, ErrorCode.SUCCESSFUL, "")

    def _replace_by(self, handle: GoalHandle, now: Cycle) -> None:
        """If a queued goal is canceled, let it replace the goals before it. Otherwise, the earlier goals would
        continue."""
        queued = [waiting for waiting, _ in tuple(self._inbox)]
        if handle not in queued or (self.active is None and queued[0] is handle):
            return
        for _ in range(queued.index(handle) + 1):
            self._activate(*self._inbox.popleft(), now)

    def _end(self, active: ActiveGoal, result: GoalResult) -> None:
        """Report the result to the client. A result that was decided earlier takes precedence."""
        end = active.ending or result
        active.handle.decide(end.status, end.error_code, end.text)
        self.active = None

    def _come_to_rest(self, active: ActiveGoal, ending: GoalResult, now: Cycle, fault: str | None) -> None:
        """Report the result when the joints are at rest. The client may plan its next goal from the positions of the
        resting joints."""
        if fault:
            LOG.error("%s: the goal ends before its joints have been measured at rest: %s", self._name, fault)
        if fault or self._relief.done:
            self._end(active, ending)

    def _halt(self, now: Cycle) -> None:
        """Stop the joints, because the active goal ended before the end of its path."""
        self.active = None
        if now.parameters.constraints.decelerate_on_cancel:
            self._brake(now)
        else:
            self._sampler.hold(now.confirmed)

    def _brake(self, now: Cycle) -> None:
        """Stop along the path, then relieve joints that press against an obstacle."""
        self._sampler.stop(now.reference, now.parameters, along=True)
        self._relief.begin()

    def _take_goals(self, now: Cycle) -> None:
        while self._inbox:
            handle, plan = self._inbox.popleft()
            active = self._activate(handle, plan, now)
            if self._inbox:
                continue  # A newer goal in the queue replaces this goal immediately.
            # A trajectory received on the topic may be part of a stream. If every trajectory in a stream waited, the
            # arm would never move.
            waits = bool(now.parameters.wait_for) and not handle.goal.from_topic
            if not waits or self._ready(now):
                # The first cycle is not counted, because the other controllers cannot have changed yet.
                active.recall_s = max(RECALL_S, now.step_s) + now.step_s if waits else 0.0
                self._begin(active, now)
            else:
                self._sampler.stop(now.reference, now.parameters, along=True)

    def _activate(self, handle: GoalHandle, plan: Plan, now: Cycle) -> ActiveGoal:
        """Replace the active goal."""
        if self.active:
            text = PREEMPTED_BY_TOPIC if handle.goal.from_topic else PREEMPTED
            self._end(self.active, GoalResult(GoalStatus.ABORTED, ErrorCode.INVALID_GOAL, text))
        tolerances = self._tolerances(handle.goal.tolerances, now.tolerances)
        self.active = ActiveGoal(handle, plan, tolerances, FaultTimeout(self._joints), _late_s(handle.goal, now))
        return self.active

    def _tolerances(self, asked: Tolerances, default: Tolerances) -> Tolerances:
        """Return the tolerances of a goal. As in ros2_control, invalid tolerances are replaced by the defaults."""
        try:
            return resolve(asked, default, self._joints)
        except ValueError as error:
            LOG.error("%s: %s. Using default tolerances.", self._name, error)
            return default

    def _begin(self, active: ActiveGoal, now: Cycle) -> None:
        # A stamp is an absolute time, so the waiting time counts as part of the trajectory.
        waited_s = active.waited_s if active.handle.goal.delay_s else 0.0
        try:
            path = active.plan.join(now.reference, waited_s)
        except Exception as error:  # A defect in a goal must not stop the controller.
            self._finish(active, cannot_begin(self._name, error), now)
            return
        if stretched(path):
            self._stretches.log(active.handle.goal, path, now.state.stamp_s)
        active.begun, self._relief.due = True, False
        self._sampler.follow(path, now.reference)

    def _go_on(self, active: ActiveGoal, now: Cycle) -> None:
        fault = self._lasting_fault(active, now)
        if active.ending:
            self._come_to_rest(active, active.ending, now, fault)
        elif fault:
            self._finish(active, GoalResult(GoalStatus.ABORTED, ErrorCode.PATH_TOLERANCE_VIOLATED, fault), now)
        elif not active.begun:
            self._wait(active, now)
        elif active.recall_s > 0.0 and self._recalled(active, now):
            self._sampler.stop(now.reference, now.parameters, along=True)
        elif self._sampler.path is not None and (found := self._result(active, self._sampler.path, now)):
            self._finish(active, found, now)

    def _result(self, active: ActiveGoal, path: Path, now: Cycle) -> GoalResult | None:
        """Return the result of the goal, or None while the goal is still running or waiting."""
        if now.waits:
            return None
        after_end_s = self._sampler.elapsed_s - path.duration_s
        if after_end_s >= 0.0:
            found = result_at_end(self._joints, active.tolerances, path, after_end_s, now.error)
            if found and not found.stop and not now.state.faults.keys().isdisjoint(self._joints):
                return None  # The last known position of an unmeasured joint does not prove that the joint has arrived.
            return found if found is None or found.stop or active.settles(now, self._sampler.still) else None
        if excess(self._joints, now.error, active.tolerances.path, now.state.faults):
            return active.off_path(self._joints, now)
        return None

    @staticmethod
    def _lasting_fault(active: ActiveGoal, now: Cycle) -> str | None:
        if not now.state.faults and not active.fault_timeout.cycles:
            return None
        return active.fault_timeout.lasting(now.state.faults, now.period_s)

    def _ready(self, now: Cycle) -> bool:
        return all(map(self._others_settled, now.parameters.wait_for))

    def _recalled(self, active: ActiveGoal, now: Cycle) -> bool:
        """Return whether a goal that has just started must be put back into the waiting state."""
        active.recall_s -= now.step_s
        active.waited_s += now.step_s
        active.begun = self._ready(now)
        return not active.begun

    def _wait(self, active: ActiveGoal, now: Cycle) -> None:
        """Start the goal when the other controllers have settled or when the wait times out."""
        ready = self._ready(now)
        late = active.waited_s >= now.parameters.wait_for_timeout
        if late and not ready:
            text = "%s: starting the goal although %s has not settled"
            LOG.warning(text, self._name, ", ".join(now.parameters.wait_for))
        if ready or late:
            self._begin(active, now)
        else:
            active.waited_s += now.step_s

    def _finish(self, active: ActiveGoal, result: GoalResult, now: Cycle) -> None:
        if result.status is GoalStatus.ABORTED:
            LOG.error("%s: %s", self._name, result.text)
        if result.at_rest and (now.parameters.constraints.decelerate_on_cancel or self._sampler.ended):
            active.ending = result
            self._brake(now)
            return
        self._end(active, result)
        if result.stop:
            self._halt(now)


def _late_s(goal: TrajectoryGoal, now: Cycle) -> float:
    """Return the delay (s) of this cycle relative to the cycle for which the goal was planned."""
    late_s = 0.0 if goal.begins_s is None else now.state.stamp_s - goal.begins_s
    return late_s if late_s > LATE_S else 0.0
