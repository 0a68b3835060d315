"""Invariant on forward controllers, such as the hand's controller: commands follow the values that clients send."""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from hal.types import FloatArray, JointState
from servoloop.campaign.invariants.invariant import Invariant
from servoloop.campaign.invariants.motion.smoothness import UPSET_S
from servoloop.simulation.faulty_stack import FaultyStack

FORWARDED_S: Final = 0.5
"""Time allowed for a joint with a forward controller to start and stop, in seconds."""
FORWARDED_FACTOR: Final = 1.2
"""Allowed duration of a motion, as a multiple of the time the joint takes over its whole range at its velocity
limit."""
FORWARDED_SHARE: Final = 0.01
"""Allowed distance from the commanded value, as a fraction of the joint's range."""
FORWARDED_ACCELERATION: Final = 1.05
"""Allowed acceleration of a forward controller's command, as a multiple of the limit."""
COMMANDS: Final = 3
"""Number of commands from which an acceleration is calculated."""
OVERSHOOT_SHARE: Final = 1e-4
"""Maximum overshoot of a command, as a fraction of the joint's range."""


@dataclass(slots=True)
class _Forwarded:
    """Latest values sent to a forward controller."""

    values: tuple[float, ...]
    ways: tuple[int, ...]
    """Direction in which each joint must move, 1 or -1, or 0 if its command was not at rest."""
    cycles: int = 0
    """Number of cycles for which the values have been valid.

    Time is counted in cycles, because writing to a servo that does not respond delays the loop.
    """


class ForwardedIsFollowed(Invariant):
    """The command of a joint promptly reaches the latest value that a client sent to its forward controller.

    The command stays within the acceleration limit. A command that starts from rest does not overshoot the value.
    """

    name = "forwarded values are followed"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._sent: dict[str, _Forwarded] = {}
        """Latest values sent to each forward controller."""
        self._commands: dict[str, deque[FloatArray]] = {}
        """Commands (k,) of each forward controller in the latest cycles, oldest first."""
        self._upset_s: dict[str, float] = {}
        """Time of the latest cycle in which each controller had a fault."""

    def on_state(self, state: JointState) -> None:
        for name, controller in self.stack.controllers.items():
            running = self.active and self.stack.manager.registry.loaded[name].active
            if controller.takes_goals or controller.upsets or not running:
                controller.forwarded = None
                self._commands.pop(name, None)
                if controller.upsets:
                    self._upset_s[name] = state.stamp_s
                continue
            joints = [interface.rpartition("/")[0] for interface in controller.command_interfaces]
            self._append(name, joints, state)
            sent, values = self._sent.get(name), controller.forwarded
            if values is None:
                self._sent.pop(name, None)
            elif sent is None or sent.values != values:
                self._sent[name] = _Forwarded(values, self._ways(name, joints, values))
            else:
                sent.cycles += 1
                if state.stamp_s - self._upset_s.get(name, -UPSET_S) >= UPSET_S:
                    self._examine_acceleration(name, joints)
                self._examine(joints, sent)

    def _append(self, name: str, joints: Sequence[str], state: JointState) -> None:
        """Store the latest commands. Commands of limp joints are discarded, because they follow the joints."""
        places, commands = self._places(joints), self._commands.setdefault(name, deque(maxlen=COMMANDS))
        taken_over = commands and (commands[-1] != self.stack.loop.previous_command[places]).any()
        if taken_over or not state.faults.keys().isdisjoint(joints):
            commands.clear()
        commands.append(self.stack.loop.command[places])

    def _places(self, joints: Sequence[str]) -> list[int]:
        return [self.commanded.index(joint) for joint in joints]

    def _within(self, joint: str, value: float) -> float:
        limit = self.stack.loop.limits[self.commanded.index(joint)]
        return min(max(value, limit.lower), limit.upper)

    def _ways(self, name: str, joints: Sequence[str], values: Sequence[float]) -> tuple[int, ...]:
        """Return the direction from each previous command to a new value, or 0 for all joints that were not at rest."""
        commands = self._commands[name]
        if len(commands) < COMMANDS:
            return (0,) * len(joints)
        ends = np.array([self._within(*one) for one in zip(joints, values, strict=True)])
        return tuple((np.sign(ends - commands[1]) * (commands[0] == commands[1])).astype(int).tolist())

    def _examine_acceleration(self, name: str, joints: Sequence[str]) -> None:
        """Check the acceleration of the latest commands, except at a limit."""
        commands = list(self._commands[name])
        if len(commands) < COMMANDS:
            return
        self.examined += 1
        changes = np.abs(commands[2] - 2.0 * commands[1] + commands[0]) / self.stack.loop.period_s**2
        for joint, command, change in zip(joints, commands[2], changes.tolist(), strict=True):
            limit = self.stack.loop.limits[self.commanded.index(joint)]
            if limit.lower < command < limit.upper and change > FORWARDED_ACCELERATION * limit.acceleration:
                text = f"{change:.2f}, but its limit is {limit.acceleration:.2f}"
                self.say(f"a forward controller moves the command of {joint} with an acceleration of {text}")

    def _examine(self, joints: Sequence[str], sent: _Forwarded) -> None:
        lasted_s = (sent.cycles + 1) * self.stack.loop.period_s
        for joint, value, way in zip(joints, sent.values, sent.ways, strict=True):
            place = self.commanded.index(joint)
            limit = self.stack.loop.limits[place]
            range_ = limit.upper - limit.lower
            command, wanted = float(self.stack.loop.command[place]), self._within(joint, value)
            if way * (command - wanted) > OVERSHOOT_SHARE * range_:
                self.say(f"the command of {joint} overshoots {wanted:.4f} by {abs(command - wanted):.4f}")
            if lasted_s <= FORWARDED_FACTOR * range_ / limit.velocity + FORWARDED_S:
                continue
            self.examined += 1
            if abs(command - wanted) > FORWARDED_SHARE * range_:
                self.say(f"{joint} is commanded to {command:.4f}, although {wanted:.4f} was sent {lasted_s:.1f} s ago")
