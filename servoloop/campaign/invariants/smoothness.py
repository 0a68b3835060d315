"""What must hold of how commands change: acceleration and jerk, and what becomes of a command that is no number."""

from collections import deque
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from hal.types import FloatArray, JointState
from servoloop.campaign.invariants.invariant import Invariant
from servoloop.simulation.faulty_stack import FaultyStack

LATE: Final = 1.5
"""Periods after which a cycle comes late."""
SHARE: Final = 1.02
"""Largest share of a limit that the differences of a sampled reference come to: they are means."""
STOP_JERK_SHARE: Final = 3.0
"""Jerk of a stop on a path as a share of the limit: the path's own jerk, and that of braking on it."""
RELIEF_SHARE: Final = 2.0
"""The same where joints are relieved at the end: commands are ahead of the way by the servos' lag."""
COMMANDS_SHARE: Final = 1.05
"""The same for the commands at the end: each is sent for the end of the coming period."""


class SmoothReference(Invariant):
    """The reference of a jerk-limited trajectory controller keeps the acceleration and the jerk of its joints.

    That counts for the way to a goal and for every stop. Cycles that come late are left out: the reference goes on by
    at most two periods then.
    """

    name = "smooth reference"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None]) -> None:
        super().__init__(stack, say)
        limits = [stack.loop.limits[self.commanded.index(joint)] for joint in stack.arm.joints]
        self._acceleration = np.array([limit.acceleration for limit in limits])
        self._jerk = np.array([limit.jerk for limit in limits])
        self._references = deque[FloatArray](maxlen=4)
        self._stops = deque[bool](maxlen=4)
        self._times = deque[float](maxlen=4)

    def on_state(self, state: JointState) -> None:
        arm, tracking = self.stack.arm, self.stack.arm.tracking
        waits = all(joint in state.faults for joint in arm.joints)  # the goal waits, and its reference stands
        late = state.stamp_s - self._times[-1] > LATE * self.stack.loop.period_s if self._times else False
        if tracking is None or waits or late or arm.parameters.interpolation_method != "ruckig":
            self._times.clear()
            self._references.clear()
            self._stops.clear()
        if tracking is None or waits:
            return
        self._times.append(state.stamp_s)
        self._references.append(tracking.reference.position)
        self._stops.append(not tracking.on_goal)
        if len(self._references) == 4:
            self.examined += 1
            times, references = list(self._times), np.array(self._references)
            self._compare("accelerates", divided(references[1:], times[1:]), self._acceleration)
            most = STOP_JERK_SHARE if any(self._stops) else 1.0
            self._compare("jerks", divided(references, times), most * self._jerk)

    def _compare(self, what: str, value: FloatArray, limits: FloatArray) -> None:
        shares = np.abs(value) / limits
        worst = int(shares.argmax())
        if shares[worst] > SHARE:
            found = f"{shares[worst] * limits[worst]:.1f}, allowed is {limits[worst]:.1f}"
            self.say(f"the reference of {self.stack.arm.joints[worst]} {what} with {found}")


def divided(values: FloatArray, times_s: Sequence[float]) -> FloatArray:
    """The mean of the highest derivative that so many values (m, n) at these times determine, shape (n,)."""
    order = 1
    while len(values) > 1:
        values = np.array(
            [order * (values[i + 1] - values[i]) / (times_s[i + order] - times_s[i]) for i in range(len(values) - 1)]
        )
        order += 1
    derivative: FloatArray = values[0]
    return derivative


class SmoothEnd(Invariant):
    """While the program ends, every joint is stopped and parked within its acceleration limit."""

    name = "smooth end"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None]) -> None:
        super().__init__(stack, say)
        self._acceleration = np.array([limit.acceleration for limit in stack.loop.limits])
        self._commands = deque[FloatArray](maxlen=3)

    def on_command(self, values: FloatArray) -> None:
        if not self.stack.ending or not self.active:
            self._commands.clear()
            return
        self._commands.append(values.copy())
        if len(self._commands) == 3:
            self.examined += 1
            change = np.abs(np.diff(np.array(self._commands), 2, axis=0)[0]) / self.stack.loop.period_s**2
            worst = int((change / self._acceleration).argmax())
            share = COMMANDS_SHARE if self.stack.relaxes else RELIEF_SHARE
            if change[worst] > share * self._acceleration[worst]:
                found = f"{change[worst]:.1f}, its limit is {self._acceleration[worst]:.1f}"
                self.say(f"{self.commanded[worst]} is stopped or parked with an acceleration of {found}")


class NanHolds(Invariant):
    """While a controller commands NaN its joints hold: no command of theirs changes."""

    name = "nan holds"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None]) -> None:
        super().__init__(stack, say)
        self._names = list(stack.loop.hardware.command_interfaces)
        self._held: dict[int, float] = {}

    def on_state(self, state: JointState) -> None:
        loop = self.stack.loop
        places = [
            self._names.index(interface)
            for name, controller in self.stack.controllers.items()
            if self.stack.manager.registry.loaded[name].active and any(how == "nan" for how, _ in controller.upsets)
            for interface in controller.command_interfaces
        ]
        held = {place: float(loop.command[place]) for place in places} if self.active else {}
        for place in held.keys() & self._held.keys():
            self.examined += 1
            if held[place] != self._held[place]:
                self.say(f"{self._names[place]} is commanded NaN and moves from {self._held[place]} to {held[place]}")
        self._held = held
