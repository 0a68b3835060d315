"""What must hold of what the stack reports of its joints."""

from collections import Counter, defaultdict
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from drivers.printable import counted
from drivers.servos import sts
from hal.joint import Joint
from hal.types import FloatArray, JointState
from servoloop.campaign.invariants.invariant import Invariant, complains
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.touches import touched_joints
from sim_backend.faults.event import Event
from sim_backend.servos.sts.servo import VirtualServo

_POSITION: Final = slice(sts.present_position.address, sts.present_position.address + sts.present_position.size)

CYCLES_TO_NAME: Final = 2
"""In so many cycles a servo that is not heard is named."""
FOUND_S: Final = 0.5
"""Torque that a servo lost without a word is found within this time at 20 Hz."""
UNHEARD: Final = ("silent", "cable_cut", "wrong_rate")
"""Faults with which a servo does not answer as long as they last."""
PASSING: Final = frozenset(
    {"silent", "lost_replies", "late_replies", "truncated_replies", "flipped_replies", "noise", "echo", "wrong_rate"}
)
"""Faults after which a servo is as it was before."""
TAKEN_BACK_S: Final = 2.0
"""Time in which a servo that answers again is asked and taken back."""
SAMPLED_COUNTS: Final = 3.0
"""A servo that turns passes so many counts between two of our looks at it."""


class NamedAlone(Invariant):
    """A servo that is not heard is named within two cycles, and no joint is named whose servo and line are well.

    What is wrong with another servo is no excuse. Two servos with one ID are left out: either may have answered.
    """

    name = "named, and it alone"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None]) -> None:
        super().__init__(stack, say)
        self._unnamed, self._misnamed = Counter[str](), Counter[str]()

    def on_state(self, state: JointState) -> None:
        if not self.active or self.shared_id:
            self._unnamed.clear()
            self._misnamed.clear()
            return
        active = self.stack.player.active.values()
        silent = {name for event in active if self._unheard(event) for name in touched_joints(event, self.joints)}
        well = {joint.name for joint in self.joints if not self.stack.touches.kinds(joint.name) and self._works(joint)}
        self.examined += len(silent) + len(well) * bool(active)
        self._unnamed = Counter({joint: self._unnamed[joint] + 1 for joint in silent - state.faults.keys()})
        self._misnamed = Counter({joint: self._misnamed[joint] + 1 for joint in state.faults.keys() & well})
        for wrong, what in ((self._unnamed, "is silent, and nothing says so"), (self._misnamed, "is named, and well")):
            for joint, cycles in wrong.items():
                if cycles > CYCLES_TO_NAME:
                    self.say(f"{joint} {what}, for {counted(cycles, 'cycle')}")

    def _unheard(self, event: Event) -> bool:
        """Whether a servo with this fault does not answer."""
        rates = {port.baud for port in self.stack.ports.values()}
        return event.kind in UNHEARD and getattr(event, "baud", None) not in rates

    def _works(self, joint: Joint) -> bool:
        """Whether the joint's servo drives its motor and has not protected itself from the load on its joint."""
        return self.torque(joint) and not complains(joint, self.servos[joint.name])


class TakenBack(Invariant):
    """A joint whose servo answers again, under torque, is taken back into the cycle."""

    name = "taken back"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None]) -> None:
        super().__init__(stack, say)
        self._named_s = defaultdict[str, float](float)

    def on_state(self, state: JointState) -> None:
        for joint in self.joints:
            touches = self.stack.touches
            passing = touches.kinds(joint.name) <= PASSING and touches.since_s(joint.name) > 0.0
            if not self.active or self.shared_id or not passing or not self.torque(joint):
                self._named_s[joint.name] = 0.0
                continue
            self.examined += touches.since_s(joint.name) < TAKEN_BACK_S
            named = joint.name in state.faults
            self._named_s[joint.name] = self._named_s[joint.name] + self.stack.loop.period_s if named else 0.0
            if self._named_s[joint.name] > TAKEN_BACK_S:
                text = state.faults[joint.name].text
                self.say(f"{joint.name} answers again and is not taken back for {TAKEN_BACK_S:g} s: {text}")


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
            self.examined += 1
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
            known = not self.active or joint.name in state.faults or self.stack.touches.since_s(joint.name) <= 0.0
            self.examined += not known and bool(self.stack.touches.kinds(joint.name))
            if known or self.torque(joint):
                self._limp_since_s.pop(joint.name, None)
                continue
            limp_s = state.stamp_s - self._limp_since_s.setdefault(joint.name, state.stamp_s)
            if limp_s > FOUND_S + 2.0 * self.stack.loop.period_s:
                self.say(f"{joint.name} is limp for {limp_s:.2f} s, and nothing says so")
