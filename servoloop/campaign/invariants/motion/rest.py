"""Invariants after a goal ends: the arm comes to rest, stays there, and does not press against anything."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.action_goals import GoalStatus
from controller.trajectory.goal import TrajectoryGoal
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from hal.types import FloatArray, JointState
from servoloop.api.freedrive import FREEDRIVE
from servoloop.api.stream_gate import STREAM
from servoloop.campaign.invariants.invariant import Invariant
from servoloop.simulation.faulty_stack import FaultyStack

STAYS: Final = 0.01
"""Largest change of a command after the joints of a finished goal are at rest, as a fraction of the joint's range."""
RESTS: Final = 0.1
"""Speed below which a joint counts as at rest, in rad/s."""
CREEPS: Final = 0.01
"""Speed above which a joint moves freely, in rad/s or m/s."""
BRAKES: Final = 1.3
"""Factor by which the shortest braking time of the slowest joint is multiplied, because all joints brake together along
the path."""
TURNS: Final = 0.25
"""Distance that a joint covers from rest to rest, as a fraction of its acceleration times the square of the time."""
PRESSES_SHARE: Final = 0.03
"""Allowed distance between the command and the joint, as a fraction of the joint's range. Servos give way under load,
and relief is not exact."""
RELIEVED_S: Final = 0.3
"""Maximum time a joint may press against an obstacle after a result that waited for relief, in seconds."""
RELIEVED_AFTER_FAULT_S: Final = 3.0
"""Maximum time a joint may press after a fault or a deactivation has ended a goal, in seconds.

Such a goal reports its result without waiting for relief.
"""
RELIEF_OVER_S: Final = 0.5
"""Time without a change of any command after which the relief of the arm counts as complete, in seconds."""


@dataclass(slots=True)
class _End:
    """Range of commands (rad or m) in which the joints may come to rest after a goal."""

    lowest: FloatArray
    highest: FloatArray
    since_s: float
    here: FloatArray
    """Joint positions in the previous cycle."""

    def extend(self, here: FloatArray, reported: FloatArray, period_s: float) -> None:
        """Extend the range to the positions of joints at rest, which may be blocked and whose commands may give way.

        Args:
            here: True positions, shape (n,).
            reported: Lowest and highest positions that the servos may report for the joints, shape (2, n).
            period_s: Time since the previous cycle, in seconds.
        """
        rests = np.abs(here - self.here) < RESTS * period_s
        self.lowest = np.where(rests, np.minimum(self.lowest, reported[0]), self.lowest)
        self.highest = np.where(rests, np.maximum(self.highest, reported[1]), self.highest)
        self.here = here


class NothingTravels(Invariant):
    """After a goal or a stream of targets has ended, commands only brake the joints or give way to an obstacle."""

    name = "nothing travels after the end"
    of_each_arm = True

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._places = [self.commanded.index(joint) for joint in arm.joints]
        limits = [stack.loop.limits[place] for place in self._places]
        self._range = np.array([min(limit.upper - limit.lower, 7.0) for limit in limits])
        self._acceleration = np.array([limit.acceleration for limit in limits])
        self._jerk = np.array([limit.jerk for limit in limits])
        velocity = np.array([limit.velocity for limit in limits])
        self._brakes_s = float((velocity / self._acceleration + self._acceleration / self._jerk).max())
        """Maximum braking time of the joints, in seconds."""
        self._end: _End | None = None
        self._streamed = False
        """Whether a stream was driving the arm in the previous cycle."""

    def on_state(self, state: JointState) -> None:
        loop = self.stack.loop
        command = loop.command[self._places]
        streamed, self._streamed = self._streamed, self._streams()
        if self._disturbed(state):
            self._end = None
            return
        ended = [one.goal for one in self.stack.ended_goals if one.controller == self.arm.name]
        if streamed or ended:
            self._end = self._begun(command, loop.previous_command[self._places], ended)
        if self._end is None:
            return
        here = self._true()
        self._end.extend(here, self._reported(here, state), self.stack.loop.period_s)
        self.examined += 1
        slack = STAYS * self._range
        away = (command < self._end.lowest - slack) | (command > self._end.highest + slack)
        if away.any():
            joint = self.arm.joints[int(np.flatnonzero(away)[0])]
            after_s = state.stamp_s - self._end.since_s
            self.say(
                f"{joint} is commanded to {command[away][0]:.4f} without a goal, {after_s:.2f} s after the last goal"
            )

    def _streams(self) -> bool:
        """Return whether a stream of targets is driving the arm."""
        stream = self.stack.manager.registry.loaded.get(STREAM)
        return stream is not None and stream.active

    def _disturbed(self, state: JointState) -> bool:
        """Return whether a goal, a fault or an activation is moving the arm."""
        stack = self.stack
        entry = stack.manager.registry.loaded[self.arm.name]
        away = not self.active or not entry.active or "component" in _kinds(state)
        return bool(self.open_goals) or away or self.upset

    def _begun(self, command: FloatArray, before: FloatArray, ended: Sequence[TrajectoryGoal]) -> _End:
        """Return the range in which the joints may come to rest while they brake along the paths of ended goals."""
        velocity = (command - before) / self.stack.loop.period_s
        speed = np.abs(velocity)
        brakes_s = float((speed / self._acceleration + self._acceleration / self._jerk).max())
        rests = command + velocity * (BRAKES * brakes_s + 2.0 * self.stack.loop.period_s)
        here = self._true()
        reach = speed * self._brakes_s + TURNS * self._acceleration * self._brakes_s**2
        turns = [self._turn(command, velocity, goal, reach) for goal in ended]
        ends = np.array([command, rests, here, *(end for pair in turns for end in pair)])
        return _End(ends.min(axis=0), ends.max(axis=0), self.stack.clock.now(), here)

    def _turn(
        self, command: FloatArray, velocity: FloatArray, goal: TrajectoryGoal, reach: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the ends of the range (n,) that joints reach toward the waypoints of a goal.

        Along a path with several points, a joint may reverse its direction while another joint brakes. Along a path to
        one point, only a joint that moves away from this point reverses, because of an earlier motion.
        """
        lowest, highest = command.copy(), command.copy()
        for place, joint in enumerate(self.arm.joints):
            if joint not in goal.joints:
                continue
            column = goal.joints.index(joint)
            positions = [point.positions[column] for point in goal.points]
            if len(positions) == 1 and (positions[0] - command[place]) * velocity[place] >= 0.0:
                continue
            lowest[place] = min(lowest[place], max(min(positions), command[place] - reach[place]))
            highest[place] = max(highest[place], min(max(positions), command[place] + reach[place]))
        return lowest, highest

    def _true(self) -> FloatArray:
        true = self.true_positions()
        return np.array([true[joint] for joint in self.arm.joints])

    def _reported(self, here: FloatArray, state: JointState) -> FloatArray:
        """Return the lowest and the highest positions (2, n) that the servos may report for true positions (n,)."""
        ends = []
        for joint, true in zip(self.arm.joints, here.tolist(), strict=True):
            readings = self.readings(joint, true)
            if self.deceived(joint):
                readings.append(float(state.position[self.stack.loop.hardware.joints.index(joint)]))
            ends.append((min(readings), max(readings)))
        return np.array(ends).T


class NothingPresses(Invariant):
    """Shortly after a goal has failed or the arm's controller was activated, no joint is driven against an obstacle.

    Relieving one joint may move another joint, which is then relieved next. After the relief, something else may push a
    joint away from its command, such as an external torque or the gripper. This distance does not count until a command
    of the arm changes, because an arm without a goal keeps its commands. While a joint is blocked outside its limits,
    its command stays at the limit and cannot relieve the joint, which may also push its neighbors.
    """

    name = "nothing presses after the end"
    of_each_arm = True

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._by_name = {joint.name: joint for joint in self.joints}
        self._places = {joint: self.commanded.index(joint) for joint in arm.joints}
        self._allowed = {
            joint: PRESSES_SHARE * (stack.loop.limits[place].upper - stack.loop.limits[place].lower)
            for joint, place in self._places.items()
        }
        self._others = [i for i in range(len(self.commanded)) if i not in self._places.values()]
        """Indices of the commands of all other joints, such as the gripper."""
        self._off_s = defaultdict[str, float](float)
        """Time each joint has pressed against an obstacle while no joint was relieved, in seconds."""
        self._pressed_s = defaultdict[str, float](float)
        """Time each joint has pressed against an obstacle, even while other joints were relieved, in seconds."""
        self._before: dict[str, tuple[float, float]] = {}
        """Position and command of each joint in the last cycle."""
        self._guided = False
        """Whether the arm has been moved by hand since the last goal."""
        self._streamed = False
        """Whether another controller has driven joints of the arm since the last goal."""
        self._delayed = False
        """Whether the controller was inactive or a joint had a fault since the last goal ended, so that the relief may
        be late."""
        self._activated = False
        """Whether the controller was activated after the last goal had ended."""
        self._running = False
        """Whether the controller was active in the last cycle."""
        self._last: object = None
        self._commands_kept_s = 0.0
        """Time since a command of the arm last changed, in seconds."""
        self._relief_over = False
        """Whether the relief is complete. The commands of the arm must be constant, either for some time or since the
        command of another joint changed."""
        self._least_off: dict[str, float] = {}
        """Smallest following error of each joint since the relief was complete. A joint that something else pushes away
        later does not count as pressing."""

    def on_state(self, state: JointState) -> None:
        period_s = self.stack.loop.period_s
        freedrive = self.stack.manager.registry.loaded.get(FREEDRIVE)
        self._guided = not self.open_goals and (self._guided or (freedrive is not None and freedrive.active))
        if self._guided:
            self._off_s.clear()
            return
        ended = [one for one in self.stack.goals.goals if one.controller == self.arm.name and one.ended_s]
        running = self.stack.manager.registry.loaded[self.arm.name].active
        self._activated = not self.open_goals and (self._activated or (running and not self._running))
        self._running = running
        unwanted = self._activated or (bool(ended) and ended[-1].handle.status is not GoalStatus.SUCCEEDED)
        true = self.true_positions()
        self._measure_distances(true)
        if self.open_goals or not unwanted or not self.active or self.upset or self._blocked_outside(state):
            self._forget()
            return
        last = ended[-1].handle if ended else None
        streamed = self._driven_by_others()
        self._streamed = bool(streamed) or (self._streamed and last is self._last)
        self._delayed = not running or bool(state.faults) or (self._delayed and last is self._last)
        self._last = last
        relieved = last is not None and (last.status is GoalStatus.CANCELED or "is off by" in last.error_text)
        waited = relieved and not (self._delayed or self._streamed or self._activated)
        relieved_s = RELIEVED_S if waited else RELIEVED_AFTER_FAULT_S
        relieved_now = {joint for joint in self._places if self._relieving(joint, true[joint])}
        for joint, place in self._places.items():
            known = not self.deceived(joint) and joint not in state.faults and self.torque(self._by_name[joint])
            command = float(self.stack.loop.command[place])
            creeps = abs(true[joint] - self._before.get(joint, (true[joint], command))[0]) > CREEPS * period_s
            off = not (creeps or joint in relieved_now) and self._least_off[joint] > self._allowed[joint]
            self.examined += known
            pressed = known and off and joint not in streamed
            self._pressed_s[joint] = self._pressed_s[joint] + period_s if pressed else 0.0
            self._off_s[joint] = self._off_s[joint] + period_s if pressed and not relieved_now else 0.0
            long = self._off_s[joint] > relieved_s or self._pressed_s[joint] > RELIEVED_AFTER_FAULT_S
            if long and not self._pulled(joint):
                self.say(f"{joint} is blocked at {true[joint]:.4f} but commanded to {command:.4f} without a goal")
            self._before[joint] = true[joint], command

    def _measure_distances(self, true: dict[str, float]) -> None:
        """Update the smallest distances of the joints at their ``true`` positions from their commands."""
        loop = self.stack.loop
        places = list(self._places.values())
        kept = np.array_equal(loop.command[places], loop.previous_command[places])
        self._commands_kept_s = self._commands_kept_s + loop.period_s if kept else 0.0
        pushes = not np.array_equal(loop.command[self._others], loop.previous_command[self._others])
        self._relief_over = kept and (self._relief_over or pushes or self._commands_kept_s > RELIEF_OVER_S)
        before = self._least_off if self._relief_over else {}
        off = {joint: self.off_command(joint, true[joint]) for joint in self._places}
        self._least_off = {joint: min(now, before.get(joint, now)) for joint, now in off.items()}

    def _blocked_outside(self, state: JointState) -> bool:
        """Return whether the position that a servo reports is outside the limits of its joint."""
        positions = dict(zip(self.stack.loop.hardware.joints, state.position.tolist(), strict=True))
        limits = {joint: self.stack.loop.limits[place] for joint, place in self._places.items()}
        return any(
            not limits[joint].lower - slack <= positions[joint] <= limits[joint].upper + slack
            for joint, slack in self._allowed.items()
        )

    def _forget(self) -> None:
        self._off_s.clear()
        self._pressed_s.clear()

    def _relieving(self, joint: str, true: float) -> bool:
        """Return whether the command of a joint has moved towards its true position since the last cycle."""
        command = float(self.stack.loop.command[self._places[joint]])
        command_before = self._before[joint][1] if joint in self._before else command
        return (command_before - command) * (command - true) > 0.0

    def _driven_by_others(self) -> set[str]:
        """Return the joints of the arm that another controller drives.

        The client of that controller may press these joints against an obstacle.
        """
        owners, arm = self.stack.manager.registry.claimed, self.arm.name
        return {joint for joint in self._places if owners.get(f"{joint}/position", arm) != arm}

    def _pulled(self, joint: str) -> bool:
        """Return whether a fault other than jammed gears currently affects the joint."""
        touches = self.stack.touches
        return touches.since_s(joint, touches.kinds(joint) - {"jammed"}) <= 0.0


def _kinds(state: JointState) -> set[str]:
    return {fault.kind for fault in state.faults.values()}
