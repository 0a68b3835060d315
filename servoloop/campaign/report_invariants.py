"""What must hold of what the stack reports of its joints."""

from collections import Counter
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from drivers.printable import counted
from drivers.servos import sts
from hal.types import FloatArray, JointState
from servoloop.campaign.invariant import Invariant
from servoloop.simulation.faulty_stack import FaultyStack
from sim_backend.sts.servo import VirtualServo

_POSITION: Final = slice(sts.present_position.address, sts.present_position.address + sts.present_position.size)

CYCLES_TO_NAME: Final = 2
"""In so many cycles a servo that is not heard is named."""
FOUND_S: Final = 0.5
"""Torque that a servo lost without a word is found within this time at 20 Hz."""
UNHEARD: Final = ("silent", "brown_out")
"""Faults of one servo, which then does not answer; the others have nothing to do with them."""
SAMPLED_COUNTS: Final = 3.0
"""A servo that turns passes so many counts between two of our looks at it."""


class NamedAlone(Invariant):
    """A servo that is not heard is named within two cycles, and as long as nothing else is wrong it alone."""

    name = "named, and it alone"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None]) -> None:
        super().__init__(stack, say)
        self._unnamed, self._misnamed = Counter[str](), Counter[str]()

    def on_state(self, state: JointState) -> None:
        begun = self.stack.player.happened
        if not self.active or any(event.kind not in UNHEARD for event in begun):
            return
        silent = {self._joint(one) for one in self.stack.player.active.values()}
        concerned = {self._joint(event) for event in begun}
        self._unnamed = Counter({joint: self._unnamed[joint] + 1 for joint in silent - state.faults.keys()})
        self._misnamed = Counter({joint: self._misnamed[joint] + 1 for joint in state.faults.keys() - concerned})
        for wrong, what in ((self._unnamed, "is silent, and nothing says so"), (self._misnamed, "is named, and well")):
            for joint, cycles in wrong.items():
                if cycles > CYCLES_TO_NAME:
                    self.say(f"{joint} {what}, for {counted(cycles, 'cycle')}")

    def _joint(self, event: Any) -> str:
        return next(j.name for j in self.joints if j.servo_id == event.servo_id and event.bus in (None, j.bus))


class MeasuredNow(Invariant):
    """A joint without a fault is reported where its servo said it is, at some moment since the last cycle.

    Not where it was before that, not where another one is, and not where it was meant to be. Two servos with one ID
    are left out: which of them answered nobody can know.
    """

    name = "measured now"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None]) -> None:
        super().__init__(stack, say)
        self._shared_before = True
        self._order = [stack.loop.hardware.joints.index(joint.name) for joint in self.joints]
        servos = [self.servos[joint.name] for joint in self.joints]
        self._said: Callable[[], NDArray[Any]] = lambda: np.array([_own_count(servo) for servo in servos])
        if len(stack.lines) == 1 and (tables := stack.bus.rig.tables) is not None:
            # Of all servos at once, and still in bytes: this happens every millisecond.
            servos = list(stack.bus.servos)
            self._said = tables[:, _POSITION].copy
        self._columns = [servos.index(self.servos[joint.name]) for joint in self.joints]
        self._steps = [self._said()]
        """What all servos said in the last cycle, and after each step since then."""

    def on_step(self, time_s: float) -> None:
        self._steps.append(self._said())

    def on_state(self, state: JointState) -> None:
        shared = self.shared_id
        said = _decoded(np.array(self._steps))[:, self._columns]
        lowest_of, highest_of = said.min(axis=0), said.max(axis=0)
        for place, joint in enumerate(self.joints):
            deceived = bool(self.servos[joint.name].on_read)  # its replies are false, not the report of them
            if joint.name in state.faults or shared or self._shared_before or deceived:
                continue
            counts = state.position[self._order[place]] / joint.units_per_count + joint.zero_counts
            lowest, highest = lowest_of[place], highest_of[place]
            if not lowest - SAMPLED_COUNTS <= counts <= highest + SAMPLED_COUNTS:
                self.say(f"{joint.name} is reported at {counts:.0f}; it was between {lowest:.0f} and {highest:.0f}")
        self._steps, self._shared_before = self._steps[-1:], shared


def _decoded(said: NDArray[Any]) -> FloatArray:
    """Counts, shape (m, n), from counts, or from the bytes of the registers, shape (m, n, 2)."""
    if said.ndim == 2:
        return said
    words = said.astype(np.int64) @ (1, 256)
    sign = 1 << (sts.present_position.sign_bit or 16)
    return np.where(words < sign, words, sign - words).astype(np.float64)


def _own_count(servo: Any) -> float:
    """What the servo says of its position when it is asked."""
    if isinstance(servo, VirtualServo):
        return servo.memory.get(sts.present_position)
    return float(servo.firmware.position)  # into the register it comes when it is asked


class LimpIsFound(Invariant):
    """A servo that lost its torque is found within half a second: a goal would switch it on where it stands."""

    name = "limp joints are found"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None]) -> None:
        super().__init__(stack, say)
        self._limp_since_s: dict[str, float] = {}

    def on_state(self, state: JointState) -> None:
        for joint in self.joints:
            known = not self.active or joint.name in state.faults or self.stack.player.active
            if known or self.torque(joint):
                self._limp_since_s.pop(joint.name, None)
                continue
            limp_s = state.stamp_s - self._limp_since_s.setdefault(joint.name, state.stamp_s)
            if limp_s > FOUND_S + 2.0 * self.stack.loop.period_s:
                self.say(f"{joint.name} is limp for {limp_s:.2f} s, and nothing says so")
