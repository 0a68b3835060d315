"""What must hold of the commands: on the wires, and where they leave the safety gate."""

import math
from collections import Counter
from collections.abc import Callable
from typing import Final

import numpy as np

from hal.types import FloatArray, JointState
from servoloop.campaign.invariant import Invariant
from servoloop.campaign.wire_monitor import WireMonitor
from servoloop.simulation.faulty_stack import FaultyStack

ROUNDING: Final = 1e-9
OFF_CYCLES: Final = 6
"""A servo that lost its power is deaf for longer; whoever switched itself off is found in fewer."""


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
        self._monitors = {
            name: WireMonitor(tuple(j for j in self.joints if j.bus == name), line, stack.loop.period_s, self._limp)
            for name, line in stack.lines.items()
        }

    def on_write(self, bus: str, data: bytes) -> None:
        monitor = self._monitors[bus]
        told = len(monitor.broken)
        monitor.see(data)
        for text in monitor.broken[told:]:
            self.say(text)

    def on_state(self, state: JointState) -> None:
        off = [joint.name for joint in self.joints if not self.torque(joint)] if not self.shared_id else []
        self._cycles_off = Counter({name: self._cycles_off[name] + 1 for name in off})
        self._limp.clear()
        self._limp.update(name for name, cycles in self._cycles_off.items() if cycles > OFF_CYCLES)


class SafeCommands(Invariant):
    """What passed the gate is finite, within the limits, and no further from the last than velocity times period.

    The layers below hold some of this as well: they must not be needed. No NaN is reported either.
    """

    name = "safe commands"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None]) -> None:
        super().__init__(stack, say)
        self._last: FloatArray | None = None
        limits = stack.loop.limits
        self._lower, self._upper = np.array([one.lower for one in limits]), np.array([one.upper for one in limits])
        self._reach = np.array([one.velocity for one in limits]) * stack.loop.period_s

    def on_state(self, state: JointState) -> None:
        if not all(map(math.isfinite, (*state.position, *state.velocity))):
            self.say("a position or a velocity that is reported is no number")
        command = self.stack.loop.command
        last, self._last = self._last, command.copy() if self.active else None
        if not self.active:
            return
        if not np.isfinite(command).all():
            self.say("the loop commands what is no number")
        # A joint that stood outside its limits when it was switched on may be on its way back.
        before = command if last is None else last
        outside = np.maximum(self._lower - command, command - self._upper)
        was_outside = np.maximum(self._lower - before, before - self._upper)
        if (outside > np.maximum(was_outside, 0.0) + ROUNDING).any():
            self.say(f"commands beyond the limits: {command.round(4).tolist()}")
        if last is not None and (np.abs(command - last) > self._reach + ROUNDING).any():
            self.say(f"commands leap within a cycle from {last.round(4).tolist()} to {command.round(4).tolist()}")
