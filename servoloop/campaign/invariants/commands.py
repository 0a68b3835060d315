"""What must hold of the commands: on the wires, and where they leave the safety gate."""

import math
from collections import Counter
from collections.abc import Callable
from typing import Final

import numpy as np

from drivers.servos.catalog import series_of
from hal.types import FloatArray, JointState
from servoloop.campaign.invariants.invariant import Invariant
from servoloop.campaign.invariants.wire_monitor import WireMonitor
from servoloop.simulation.faulty_stack import FaultyStack

ROUNDING: Final = 1e-9
TAKEN_OVER_S: Final = 0.05
"""A joint that moves is taken over where it was measured: by now it may be further by its way in this time."""
OFF_CYCLES: Final = 6
"""A servo that lost its power is deaf for longer; one that switched itself off is found in fewer."""
FOUND_CYCLES: Final = 12
"""The same for servos that a goal does not switch on: their torque is asked for less often on a bad line."""


class SafeWire(Invariant):
    """No goal outside the limits, none that leaps, and torque only with the goal at the measured position.

    Read along on the wire, whatever the layers above believe to have sent. A servo that has been limp for longer than
    a restart stays unnoticed gets a goal only where it stands: to an STS servo a goal is the order to switch on. Two
    servos with one ID are left out: which of them says that it has torque nobody can know.
    """

    name = "safe wire"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None]) -> None:
        super().__init__(stack, say)
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
        told, seen = len(monitor.broken), monitor.goals_seen + monitor.torque_on_seen
        monitor.see(data)
        self.examined += monitor.goals_seen + monitor.torque_on_seen - seen
        for text in monitor.broken[told:]:
            self.say(text)

    def on_state(self, state: JointState) -> None:
        off = [joint.name for joint in self.joints if not self.torque(joint)] if not self.shared_id else []
        self._cycles_off = Counter({name: self._cycles_off[name] + 1 for name in off})
        self._limp.clear()
        self._limp.update(name for name, cycles in self._cycles_off.items() if cycles > self._off_cycles[name])


class SafeCommands(Invariant):
    """What passed the gate is finite, within the limits, and no further from the last than velocity times period.

    The layers below hold some of this as well: they must not be needed. Where joints are taken over, after an
    activation, the last command is where the simulated world has them. A joint without a fault has finite values.
    """

    name = "safe commands"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None]) -> None:
        super().__init__(stack, say)
        self._last: FloatArray | None = None
        limits = stack.loop.limits
        self._lower, self._upper = np.array([one.lower for one in limits]), np.array([one.upper for one in limits])
        self._velocity = np.array([one.velocity for one in limits])

    def on_state(self, state: JointState) -> None:
        if math.isfinite(state.position.sum() + state.velocity.sum()):
            return
        for name, position, velocity in zip(
            self.stack.loop.hardware.joints, state.position.tolist(), state.velocity.tolist(), strict=True
        ):
            if name not in state.faults and not (math.isfinite(position) and math.isfinite(velocity)):
                self.say(f"{name} is measured, and its position or its velocity is no number")

    def on_command(self, values: FloatArray) -> None:
        command, last, before = values.copy(), self._last, self.stack.loop.previous_command
        self._last = command if self.active else None
        if not self.active:
            return
        self.examined += 1
        if not np.isfinite(command).all():
            self.say("the loop commands what is no number")
        if last is None or not np.array_equal(before, last):
            self._taken_over(before, last)
        # A joint that stood outside its limits when it was switched on may be on its way back.
        outside = np.maximum(self._lower - command, command - self._upper)
        was_outside = np.maximum(self._lower - before, before - self._upper)
        if (outside > np.maximum(was_outside, 0.0) + ROUNDING).any():
            self.say(f"commands beyond the limits: {command.round(4).tolist()}")
        reach = self._velocity * self.stack.loop.period_s
        if (np.abs(command - before) > reach + ROUNDING).any():
            self.say(f"commands leap within a cycle from {before.round(4).tolist()} to {command.round(4).tolist()}")

    def _taken_over(self, taken: FloatArray, last: FloatArray | None) -> None:
        true = self.true_positions()
        for place, name in enumerate(self.commanded):
            unchanged = last is not None and taken[place] == last[place]
            if unchanged or name not in true or self.deceived(name) or not math.isfinite(taken[place]):
                continue
            if abs(taken[place] - true[name]) > TAKEN_OVER_S * self._velocity[place]:
                self.say(f"{name} is taken over at {taken[place]:.4f}, and stands at {true[name]:.4f}")
