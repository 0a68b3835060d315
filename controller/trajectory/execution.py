"""A trajectory controller executes its goals one after the other: each begins, goes on, and ends with a result."""

import logging
from collections import deque
from collections.abc import Sequence
from typing import Final

from controller.action_goals import DEACTIVATED, PREEMPTED, GoalStatus
from controller.fault_timeout import FaultTimeout
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
from controller.trajectory.tolerances import Tolerances, excess, resolve

LOG = logging.getLogger("servoloop.controller")

LATE_S: Final = 0.001
"""From so much on, a first cycle that comes late is worth planning the way to the first point anew."""
RECALL_S: Final = 0.05
"""So long after its beginning a goal can be made to wait after all, and one cycle at least: a command that was sent to
another controller in the same instant as the goal may arrive just behind it. The arm has hardly begun by then."""


class Execution:
    """``submit`` and ``cancel`` may be called from any thread; they count from the next cycle on."""

    def __init__(self, name: str, joints: Sequence[str], sampler: TrajectorySampler, settled: Settled) -> None:
        self._name = name
        self._joints = tuple(joints)
        self._sampler = sampler
        self._relief = Relief(name, joints, sampler)
        self._unmeasured = FaultTimeout(self._joints)
        """Of joints that are relieved without a goal."""
        self._others_settled = settled
        self._inbox: deque[tuple[GoalHandle, Plan]] = deque()
        self._cancels: deque[GoalHandle] = deque()
        self.active: ActiveGoal | None = None
        self.newest: GoalHandle | None = None
        """The goal that was taken last, under way or decided."""

    def submit(self, handle: GoalHandle, plan: Plan) -> None:
        """A goal that takes the place of the one under way."""
        self._inbox.append((handle, plan))

    def cancel(self, handle: GoalHandle) -> None:
        """Stop a goal, if it is still under way then."""
        self._cancels.append(handle)

    @property
    def idle(self) -> bool:
        """No goal is under way or waiting."""
        return self.active is None and not self._inbox

    def end(self, reason: str = "") -> None:
        """All goals end with the controller; ``reason`` is added for their clients."""
        text = f"{DEACTIVATED} {reason}".rstrip()
        if self.active:
            self._end(self.active, GoalResult(GoalStatus.ABORTED, ErrorCode.INVALID_GOAL, text))
        self._relief.due = False
        self._cancels.clear()
        while self._inbox:
            self._inbox.popleft()[0].decide(GoalStatus.ABORTED, ErrorCode.INVALID_GOAL, text)

    def begin_relief(self) -> None:
        """The controller is inactive, and its joints rest."""
        self._relief.begin()
        self._unmeasured = FaultTimeout(self._joints)

    def relieve(self, now: Cycle) -> bool:
        """Run one cycle of the relief; returns whether another one is needed."""
        faults = now.state.faults
        gone = all(name in faults and faults[name].kind == "component" for name in self._joints)
        if gone or self._unmeasured.lasting(faults, now.period_s):
            return False
        self._relief.step(now)
        return not self._relief.done

    def cycle(self, now: Cycle) -> None:
        """Cancels, new goals, and the one under way."""
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
            if self.active and self.active.handle is handle and now.parameters.constraints.decelerate_on_cancel:
                if not self.active.ending:
                    self._finish(self.active, CANCELED, now)
                continue
            if self.active and self.active.handle is handle:
                self._halt(now)
            for waiting in [one for one in tuple(self._inbox) if one[0] is handle]:  # other threads append meanwhile
                self._inbox.remove(waiting)
            handle.decide(GoalStatus.CANCELED, ErrorCode.SUCCESSFUL, "")

    def _end(self, active: ActiveGoal, result: GoalResult) -> None:
        """Tell the client; an end that has come before is the one."""
        end = active.ending or result
        active.handle.decide(end.status, end.error_code, end.text)
        self.active = None

    def _come_to_rest(self, active: ActiveGoal, ending: GoalResult, now: Cycle, fault: str | None) -> None:
        """A client may plan from where the joints are when it hears of its goal's end: that is told once they rest."""
        if fault:
            LOG.error("%s: a goal ends before its joints are seen to rest: %s", self._name, fault)
        if fault or self._relief.done:
            self._end(active, ending)

    def _halt(self, now: Cycle) -> None:
        """The goal under way has ended, its path has not."""
        self.active = None
        if now.parameters.constraints.decelerate_on_cancel:
            self._brake(now)
        else:
            self._sampler.hold(now.confirmed)

    def _brake(self, now: Cycle) -> None:
        """Come to rest on the path, and press against nothing there."""
        self._sampler.stop(now.reference, now.parameters, along=True)
        self._relief.begin()

    def _take_goals(self, now: Cycle) -> None:
        while self._inbox:
            handle, plan = self._inbox.popleft()
            self.newest = handle
            if self.active:
                text = PREEMPTED_BY_TOPIC if handle.goal.from_topic else PREEMPTED
                self._end(self.active, GoalResult(GoalStatus.ABORTED, ErrorCode.INVALID_GOAL, text))
            tolerances = self._tolerances(handle.goal.tolerances, now.tolerances)
            self.active = ActiveGoal(handle, plan, tolerances, FaultTimeout(self._joints), _late_s(handle.goal, now))
            if self._inbox:
                continue  # a newer one has come already: this one is not worth beginning
            # One on the topic may be one of a stream: if each waited anew, the arm would never move.
            waits = bool(now.parameters.wait_for) and not handle.goal.from_topic
            if not waits or self._ready(now):
                # Its first cycle is this one, in which nothing can have changed yet.
                self.active.recall_s = max(RECALL_S, now.step_s) + now.step_s if waits else 0.0
                self._begin(self.active, now)
            else:
                self._sampler.stop(now.reference, now.parameters, along=True)

    def _tolerances(self, asked: Tolerances, default: Tolerances) -> Tolerances:
        """As upstream: a goal whose tolerances make no sense is executed with the defaults."""
        try:
            return resolve(asked, default, self._joints)
        except ValueError as error:
            LOG.error("%s: %s. Using default tolerances.", self._name, error)
            return default

    def _begin(self, active: ActiveGoal, now: Cycle) -> None:
        # A stamp is a point in time: waiting has brought it nearer.
        waited_s = active.waited_s if active.handle.goal.delay_s else 0.0
        try:
            path = active.plan.join(now.reference, waited_s)
        except Exception as error:  # whatever a goal asks for, the controller goes on
            self._finish(active, cannot_begin(self._name, error), now)
            return
        if stretched(path):
            how_much = f"from {path.asked_s:.2f} s to {path.duration_s:.2f} s"
            LOG.warning("%s: the limits stretch the motion %s", self._name, how_much)
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
        """The goal's result, or None while the goal goes on, or waits."""
        if now.waits:
            return None
        after_end_s = self._sampler.elapsed_s - path.duration_s
        if after_end_s >= 0.0:
            found = result_at_end(self._joints, active.tolerances, path, after_end_s, now.error)
            if found and not found.stop and not now.state.faults.keys().isdisjoint(self._joints):
                return None  # the last known position of a joint is no sign that it has arrived
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
        """Whether a goal has to wait although it has just begun."""
        active.recall_s -= now.step_s
        active.waited_s += now.step_s
        active.begun = self._ready(now)
        return not active.begun

    def _wait(self, active: ActiveGoal, now: Cycle) -> None:
        """Begin when the others have settled."""
        ready = self._ready(now)
        late = active.waited_s >= now.parameters.wait_for_timeout
        if late and not ready:
            LOG.warning("%s: starts although %s has not settled", self._name, ", ".join(now.parameters.wait_for))
        if ready or late:
            self._begin(active, now)
        else:
            active.waited_s += now.step_s

    def _finish(self, active: ActiveGoal, result: GoalResult, now: Cycle) -> None:
        if result.status is GoalStatus.ABORTED:
            LOG.error("%s: %s", self._name, result.text)
        if result.at_rest and (now.parameters.constraints.decelerate_on_cancel or self._sampler.stands):
            active.ending = result
            self._brake(now)
            return
        self._end(active, result)
        if result.stop:
            self._halt(now)


def _late_s(goal: TrajectoryGoal, now: Cycle) -> float:
    """Seconds by which this cycle comes later than the one for which the goal was planned."""
    late_s = 0.0 if goal.begins_s is None else now.state.stamp_s - goal.begins_s
    return late_s if late_s > LATE_S else 0.0
