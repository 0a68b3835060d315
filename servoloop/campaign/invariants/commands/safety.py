"""Invariants on commands, both on the bus and after the safety gate."""

import math
from collections import Counter
from collections.abc import Callable
from typing import Final

import numpy as np

from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from drivers.servos.catalog import series_of
from hal.types import FloatArray, JointState
from servoloop.api.freedrive import FREEDRIVE
from servoloop.campaign.invariants.commands.wire_monitor import WireMonitor
from servoloop.campaign.invariants.invariant import DECEIVING, Invariant
from servoloop.simulation.faulty_stack import FaultyStack

ROUNDING: Final = 1e-9
RETURN_SHARE: Final = 0.1
"""Speed at which a joint outside its limits returns, as a fraction of its velocity limit."""
THROWN_S: Final = 0.2
"""Time after an overload during which a joint may have moved since it was measured, in seconds."""
TAKEN_OVER_S: Final = 0.02
"""Maximum age, in seconds, of the measured position that a controller uses to take over a moving joint."""
OFF_CYCLES: Final = 6
"""Maximum number of cycles until the stack detects that a servo has disabled its own torque.

A servo that has lost power remains silent for longer.
"""
FOUND_CYCLES: Final = 12
"""Maximum number of cycles until the stack detects lost torque on a servo whose torque is not enabled by goals.

On a bus with many errors, the torque of such servos is read less often.
"""
SHARED_ID: Final = frozenset({"wrong_id", "collision", "eeprom_gone"})
"""Faults after which another servo may have replied instead of a servo that had lost its torque."""
WAITS_S: Final = 1.0
"""Time for which freedrive holds the joints at first, in seconds."""
STARTS: Final = 0.04
"""Largest change of a command in the first cycle of a controller, in rad or m."""
LEAP_COUNTS: Final = 300
"""Minimum difference between two position readings, in counts, at which the stack must discard both."""


class SafeWire(Invariant):
    """Goals stay within the limits and do not jump, and torque is enabled only with the goal at the measured position.

    Before an activation, the stack must have read the position at least twice. The invariant checks the bytes on the
    bus, not the commands of the layers above. Any goal enables the torque of an STS servo. As soon as the stack can
    know that a servo has lost its torque, it may send that servo only its own position as a goal. Two servos with the
    same ID are skipped, because it is unknown which of them reports its torque. Goals of servos that report false
    values are compared only with the limits and with the previous goals, except during an activation if only every
    second position is false. During an activation, the stack must compare two readings.
    """

    name = "safe wire"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._cycles_off = Counter[str]()
        self._limp: set[str] = set()
        self._off_cycles = {
            joint.name: OFF_CYCLES if series_of(joint.model).torque_by_goal else FOUND_CYCLES for joint in self.joints
        }
        self._monitors = {
            name: WireMonitor(
                *(tuple(j for j in self.joints if j.bus == name), line, stack.loop.period_s, self._limp),
                lambda: not self.active,
            )
            for name, line in stack.lines.items()
        }

    def on_write(self, bus: str, data: bytes) -> None:
        monitor = self._monitors[bus]
        reported, seen = len(monitor.broken), monitor.goals_seen + monitor.torque_on_seen
        monitor.see(data)
        self.examined += monitor.goals_seen + monitor.torque_on_seen - seen
        for joint, text, believes in monitor.broken[reported:]:
            if not believes or self._knows(joint):
                self.say(f"{joint}: {text}")

    def _knows(self, joint: str) -> bool:
        """Return whether the stack can know the position and the torque of a joint."""
        if not DECEIVING & self.stack.touches.kinds(joint):
            return True
        return not self.active and self.never_confirmed(joint, LEAP_COUNTS)

    def on_state(self, state: JointState) -> None:
        shared = self.sharing_id
        off = [joint.name for joint in self.joints if joint.name not in shared and not self.torque(joint)]
        for monitor in self._monitors.values():
            for name in monitor.enabled:
                self._cycles_off.pop(name, None)
            monitor.enabled.clear()
        self._cycles_off = Counter({name: self._cycles_off[name] + 1 for name in off})
        self._limp.clear()
        self._limp.update(name for name, cycles in self._cycles_off.items() if cycles > self._off_cycles[name])


class SafeCommands(Invariant):
    """Commands after the safety gate are finite, within the limits, and change by at most the velocity limit times the
    period.

    The safety gate does not change a command that satisfies these conditions. The layers below the gate also check some
    of these conditions, but the conditions must hold without these checks. After an activation, each joint starts at
    its position in the simulated world. The state of a joint without a fault is finite.
    """

    name = "safe commands"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._last: FloatArray | None = None
        limits = stack.loop.limits
        self._lower, self._upper = np.array([one.lower for one in limits]), np.array([one.upper for one in limits])
        self._velocity = np.array([one.velocity for one in limits])
        self._by_name = {joint.name: joint for joint in self.joints}
        self._released: set[str] = set()
        self._upset = False
        """Whether a fault of a controller has changed its commands since the previous state."""
        self._running: set[str] = set()
        """Names of the controllers that drove their joints in the previous cycle."""
        self._before_s = math.inf
        """Time of the previous state."""

    def on_state(self, state: JointState) -> None:
        self._released = self.released(state)
        upset, self._upset = self._upset or self.upset, self.upset
        for arm in () if upset else self.stack.arms:
            self._examine_gate(arm, state.stamp_s)
        self._examine_starts(upset, state.stamp_s - self._before_s > WAITS_S)
        self._before_s = state.stamp_s
        if self.active and not math.isfinite(self.stack.loop.command.sum()):
            for name, command in zip(self.commanded, self.stack.loop.command.tolist(), strict=True):
                if not math.isfinite(command) and name not in state.faults:
                    self.say(f"{name} has no fault, but its command is not a number")
        if math.isfinite(state.position.sum() + state.velocity.sum()):
            return
        for name, position, velocity in zip(
            self.stack.loop.hardware.joints, state.position.tolist(), state.velocity.tolist(), strict=True
        ):
            if name not in state.faults and not (math.isfinite(position) and math.isfinite(velocity)):
                self.say(f"{name} has no fault, but its position or velocity is not a number")

    def on_command(self, values: FloatArray) -> None:
        command, last, before = values.copy(), self._last, self.stack.loop.previous_command
        self._last = command if self.active else None
        self._upset = self._upset or self.upset
        if not self.active:
            return
        self.examined += 1
        if (np.isfinite(before) & ~np.isfinite(command)).any():  # The command is NaN until the first measurement.
            self.say("a command of the loop has become NaN")
        if last is None or self._released or not np.array_equal(before, last):
            self._taken_over(before, last)
        # A joint that was outside its limits when its torque was enabled may still be returning to them.
        outside = np.maximum(self._lower - command, command - self._upper)
        was_outside = np.maximum(self._lower - before, before - self._upper)
        if (outside > np.maximum(was_outside, 0.0) + ROUNDING).any():
            self.say(f"commands beyond the limits: {command.round(4).tolist()}")
        reach = self._velocity * self.stack.loop.period_s
        reach = np.where(was_outside > ROUNDING, RETURN_SHARE * reach, reach)
        if (np.abs(command - before) > reach + ROUNDING).any():
            self.say(f"commands jump in one cycle from {before.round(4).tolist()} to {command.round(4).tolist()}")

    def _examine_gate(self, arm: JointTrajectoryController, stamp_s: float) -> None:
        """Check that the safety gate does not change a command that is within the limits and can be reached."""
        if arm.tracking is None or arm.tracking.stamp_s != stamp_s:
            return
        loop, wanted = self.stack.loop, arm.tracking.output
        place = [self.commanded.index(joint) for joint in arm.joints]
        before, command = loop.previous_command[place], loop.command[place]
        lower, upper = self._lower[place], self._upper[place]
        safe = (lower <= before) & (before <= upper) & (lower <= wanted) & (wanted <= upper)
        safe &= np.abs(wanted - before) <= self._velocity[place] * loop.period_s
        for at in np.flatnonzero(safe & ~(np.abs(command - wanted) <= ROUNDING)).tolist():
            self.say(f"{arm.joints[at]} is commanded to {wanted[at]:.4f}, but the safety gate passes {command[at]:.4f}")

    def _examine_starts(self, upset: bool, waited: bool) -> None:
        """Check that a controller starts where the joints of the previous controller have stopped.

        Limp joints receive no goals, and freedrive follows their measured positions from its first command. If the
        stack ``waited`` for longer than freedrive holds the joints at first, freedrive follows all joints from then on.
        """
        loop, manager, before = self.stack.loop, self.stack.manager, self._running
        entries = {one.spec.name: one for one in manager.registry.running if manager.cycle.at_rest(one.index)}
        self._running = set(entries)
        excused = {FREEDRIVE} if waited else set[str]()
        for name in sorted(entries.keys() - before - excused) if self.active and not upset else ():
            place = np.array(entries[name].index, dtype=np.intp)
            command, last = entries[name].controller.command, loop.previous_command[place]
            ends = np.array([command, np.clip(command, self._lower[place], self._upper[place])])
            for at in np.flatnonzero(np.abs(ends - last).min(axis=0) > STARTS).tolist():
                joint = self.commanded[place[at]]
                if joint not in self._released:
                    self.say(f"{name} starts {joint} at {command[at]:.4f}, but the last command was {last[at]:.4f}")

    def _taken_over(self, taken: FloatArray, last: FloatArray | None) -> None:
        true, hardware = self.true_positions(), self.stack.loop.hardware
        for place, name in enumerate(self.commanded):
            activated = name in self._released and self.torque(self._by_name[name])
            unchanged = last is not None and taken[place] == last[place] and not activated
            ready = hardware.ready(hardware.command_interfaces[place])  # A lost component is not taken over.
            if unchanged or not ready or name not in true or not math.isfinite(taken[place]):
                continue
            if self.deceived(name) and not self.never_confirmed(name, LEAP_COUNTS):
                continue
            if self.stack.touches.kinds(name) & SHARED_ID or self.stack.touches.since_s(name, {"overload"}) < THROWN_S:
                continue
            endless = math.isinf(self._upper[place])
            readings = [true[name]] if endless else self.readings(name, true[name])
            if min(abs(taken[place] - one) for one in readings) > TAKEN_OVER_S * self._velocity[place]:
                self.say(f"the first command of {name} is {taken[place]:.4f}, but the joint is at {true[name]:.4f}")
