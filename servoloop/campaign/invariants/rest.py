"""What must hold after a goal has ended: the arm comes to rest, stays there, and presses against nothing."""

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.action_goals import GoalStatus
from hal.types import FloatArray, JointState
from servoloop.campaign.invariants.invariant import Invariant
from servoloop.simulation.faulty_stack import FaultyStack

STAYS: Final = 0.01
"""Largest change of a command (share of the joint's range) once a goal has ended and its joints have come to rest."""
RESTS: Final = 0.1
"""Speed (rad/s) below which a joint counts as held."""
CREEPS: Final = 0.01
"""Speed (rad/s or m/s) above which a joint moves, and nothing holds it."""
BRAKES: Final = 1.3
"""Factor on the shortest time in which the arm's slowest joint can brake: the others brake with it along the path."""
PRESSES_SHARE: Final = 0.02
"""Share of a joint's range by which its command may stay away from it: servos give way, and relief leaves a rest."""
RELIEVED_S: Final = 0.3
"""Time after a goal's result in which no joint presses: the result waits until the joints are relieved."""
RELIEVED_AFTER_FAULT_S: Final = 3.0
"""The same after a goal that a fault ended, or whose controller was deactivated: the result does not wait."""


@dataclass(slots=True)
class _End:
    """The commands (rad or m) between which joints may come to rest."""

    lowest: FloatArray
    highest: FloatArray
    since_s: float
    here: FloatArray
    """Where the joints were in the cycle before."""

    def give_way(self, here: FloatArray, period_s: float) -> None:
        """A joint that rests beside its command may be held: its command may go to where it is."""
        rests = np.abs(here - self.here) < RESTS * period_s
        self.lowest = np.where(rests, np.minimum(self.lowest, here), self.lowest)
        self.highest = np.where(rests, np.maximum(self.highest, here), self.highest)
        self.here = here


class NothingTravels(Invariant):
    """After a goal has ended no joint is commanded to go anywhere: it brakes, or gives way towards where it is held."""

    name = "nothing travels after the end"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None]) -> None:
        super().__init__(stack, say)
        self._places = [self.commanded.index(joint) for joint in stack.arm.joints]
        limits = [stack.loop.limits[place] for place in self._places]
        self._range = np.array([min(limit.upper - limit.lower, 7.0) for limit in limits])
        self._acceleration = np.array([limit.acceleration for limit in limits])
        self._jerk = np.array([limit.jerk for limit in limits])
        self._end: _End | None = None

    def on_state(self, state: JointState) -> None:
        loop = self.stack.loop
        command = loop.command[self._places]
        if self._disturbed(state):
            self._end = None
            return
        if any(one.controller == self.stack.arm.name for one in self.stack.ended_goals):
            self._end = self._begun(command, loop.previous_command[self._places])
        if self._end is None:
            return
        self._end.give_way(self._true(), self.stack.loop.period_s)
        self.examined += 1
        slack = STAYS * self._range
        away = (command < self._end.lowest - slack) | (command > self._end.highest + slack)
        if away.any():
            joint = self.stack.arm.joints[int(np.flatnonzero(away)[0])]
            after_s = state.stamp_s - self._end.since_s
            self.say(f"{joint} is sent to {command[away][0]:.4f} by no goal, {after_s:.2f} s after the last one ended")

    def _disturbed(self, state: JointState) -> bool:
        """Whether something else than the last goal's end moves the arm: a goal, a fault, an activation."""
        stack = self.stack
        entry = stack.manager.registry.loaded[stack.arm.name]
        upset = any(one.upsets for one in stack.controllers.values())
        return bool(stack.goals.open) or not self.active or not entry.active or upset or "component" in _kinds(state)

    def _begun(self, command: FloatArray, before: FloatArray) -> _End:
        velocity = (command - before) / self.stack.loop.period_s
        speed = np.abs(velocity)
        brakes_s = float((speed / self._acceleration + self._acceleration / self._jerk).max())
        rests = command + velocity * (BRAKES * brakes_s + 2.0 * self.stack.loop.period_s)
        here = self._true()
        ends = np.array([command, rests, here])
        return _End(ends.min(axis=0), ends.max(axis=0), self.stack.clock.now(), here)

    def _true(self) -> FloatArray:
        true = self.true_positions()
        return np.array([true[joint] for joint in self.stack.arm.joints])


class NothingPresses(Invariant):
    """Some time after a goal has ended, no joint of the arm is driven against what holds it."""

    name = "nothing presses after the end"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None]) -> None:
        super().__init__(stack, say)
        self._places = {joint: self.commanded.index(joint) for joint in stack.arm.joints}
        self._allowed = {
            joint: PRESSES_SHARE * (stack.loop.limits[place].upper - stack.loop.limits[place].lower)
            for joint, place in self._places.items()
        }
        self._off_s = defaultdict[str, float](float)
        self._before: dict[str, float] = {}

    def on_state(self, state: JointState) -> None:
        period_s = self.stack.loop.period_s
        ended = [one for one in self.stack.goals.goals if one.controller == self.stack.arm.name and one.ended_s]
        if self.stack.goals.open or not ended or not self.active or ended[-1].handle.status is GoalStatus.SUCCEEDED:
            self._off_s.clear()
            return
        last = ended[-1].handle
        running = self.stack.manager.registry.loaded[self.stack.arm.name].active
        waited = running and not state.faults and (last.status is GoalStatus.CANCELED or "is off by" in last.error_text)
        true, relieved_s = self.true_positions(), RELIEVED_S if waited else RELIEVED_AFTER_FAULT_S
        for joint, place in self._places.items():
            known = joint not in state.faults and not self.deceived(joint) and self.torque_of(joint)
            creeps = abs(true[joint] - self._before.get(joint, true[joint])) > CREEPS * period_s
            off = not creeps and abs(self.stack.loop.command[place] - true[joint]) > self._allowed[joint]
            self.examined += known
            self._off_s[joint] = self._off_s[joint] + period_s if known and off else 0.0
            if self._off_s[joint] > relieved_s and not self._pulled(joint):
                command = self.stack.loop.command[place]
                self.say(
                    f"{joint} is held at {true[joint]:.4f} and commanded to {command:.4f}, and no goal is under way"
                )

        self._before = true

    def _pulled(self, joint: str) -> bool:
        """Whether a fault other than jammed gears touches the joint now."""
        touches = self.stack.touches
        return touches.since_s(joint, touches.kinds(joint) - {"jammed"}) <= 0.0

    def torque_of(self, joint: str) -> bool:
        """Whether the joint's servo drives its motor."""
        return any(one.name == joint and self.torque(one) for one in self.joints)


def _kinds(state: JointState) -> set[str]:
    return {fault.kind for fault in state.faults.values()}
