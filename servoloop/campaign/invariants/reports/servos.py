"""Invariants on reported joint states and faults."""

from collections import Counter, defaultdict
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from drivers.printable import counted
from drivers.servos import sts
from drivers.servos.catalog import series_of
from hal.joint import Joint
from hal.types import FloatArray, JointFault, JointState
from servoloop.campaign.invariants.invariant import Invariant
from servoloop.campaign.invariants.reports.sensors import alarm_names
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.touches import touched_joints
from sim_backend.faults.event import Event
from sim_backend.line.line import ServoLine
from sim_backend.servos.sts.servo import VirtualServo

_POSITION: Final = slice(sts.present_position.address, sts.present_position.address + sts.present_position.size)

CYCLES_TO_NAME: Final = 2
"""Maximum number of cycles until a silent servo is reported."""
FOUND_S: Final = 0.5
"""Maximum time until the stack detects that a servo has silently lost its torque, in seconds, at a loop rate of 20
Hz."""
SILENCING: Final = ("silent", "cable_cut", "wrong_rate")
"""Faults during which a servo does not respond."""
FALSIFYING: Final = frozenset({"false_position", "false_value"})
"""Faults in which a servo itself sends false values."""
PASSING: Final = frozenset(
    {
        *("silent", "lost_replies", "late_replies", "truncated_replies", "flipped_replies"),
        *("noise", "echo", "wrong_rate", "false_position"),
    }
)
"""Faults that leave a servo unchanged after they end. ``false_value`` is not included, because the stack may then have
to assume that the servo has released its torque."""
UNCHANGING: Final = PASSING | {"jammed", "missed_instructions"}
"""Faults after which a servo works as before. Their end does not always show in its replies."""
TAKEN_BACK_S: Final = 2.5
"""Maximum time, in seconds, until a servo that responds again is included in the cycle. Late replies to lost requests
may arrive for two seconds, and the servo's torque is checked after that."""
REMAINS_S: Final = 0.5
"""Time after which a joint that is not reported has returned to the control cycle, in seconds."""
SAMPLED_COUNTS: Final = 3.0
"""Tolerance for a moving servo between two samples of its position, in counts."""
LOSING: Final = "adapter_unplugged"
"""Fault that makes a component lose a bus."""


class NamedAlone(Invariant):
    """A silent servo is reported within two cycles. A joint is not reported if its servo and its bus work.

    A fault of another servo does not excuse a violation, but a component that loses one of its buses is entirely lost.
    Two servos with the same ID are skipped, because either of them may have replied.
    """

    name = "silent servo is reported"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._missing, self._wrong = Counter[str](), Counter[str]()

    def on_state(self, state: JointState) -> None:
        self._examine_losses()
        if not self.active:
            self._missing.clear()
            self._wrong.clear()
            return
        active = self.stack.player.active.values()
        silent = {name for event in active if self._silences(event) for name in touched_joints(event, self.joints)}
        silent -= self.sharing_id
        candidates = self.joints if active else [joint for joint in self.joints if joint.name in state.faults]
        working = {joint.name for joint in candidates if self._works(joint)} - self.sharing_id
        self.examined += len(silent) + len(working) * bool(active)
        self._missing = Counter({joint: self._missing[joint] + 1 for joint in silent - state.faults.keys()})
        wrong = {name for name in state.faults.keys() & working if not self._is_lost_with_another(state.faults[name])}
        self._wrong = Counter({joint: self._wrong[joint] + 1 for joint in wrong})
        for counts, text in ((self._missing, "is silent but not reported"), (self._wrong, "works but is reported")):
            for joint, cycles in counts.items():
                if cycles > CYCLES_TO_NAME:
                    self.say(f"{joint} {text}, for {counted(cycles, 'cycle')}")

    def _examine_losses(self) -> None:
        """Check that no component is lost unless a fault has touched one of its buses."""
        for component in self.stack.loop.hardware.lost:
            touches = (self.stack.touches.kinds(joint) for joint in component.hardware.joints)
            if not any(LOSING in kinds for kinds in touches):
                self.say(f"{component.name} is lost although its adapter was never unplugged: {component.error}")

    def _is_lost_with_another(self, fault: JointFault) -> bool:
        """Return whether a joint is reported because its component has several buses and has lost one of them."""
        return fault.kind == "component" and any(LOSING in self.stack.touches.kinds(one.name) for one in self.joints)

    def _silences(self, event: Event) -> bool:
        """Return whether a servo with this fault does not respond."""
        rates = {port.baud for port in self.stack.ports.values()}
        return event.kind in SILENCING and getattr(event, "baud", None) not in rates

    def _works(self, joint: Joint) -> bool:
        """Return whether the torque of the joint's servo is enabled, the servo reports no error, and past faults have
        left it unchanged."""
        touches = self.stack.touches
        past = touches.kinds(joint.name) <= UNCHANGING and touches.since_s(joint.name) > TAKEN_BACK_S
        return past and self.torque(joint) and not self.reports_error(joint)


class TakenBack(Invariant):
    """A joint whose servo responds again with its torque enabled returns to the control cycle, and remains there."""

    name = "taken back"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._reported_s: dict[str, float] = {}
        """Time since each joint was reported first, in seconds. A joint that stays healthy is removed."""
        self._healthy_s = defaultdict[str, float](float)
        """Time for which each joint has not been reported, in seconds."""

    def on_state(self, state: JointState) -> None:
        period_s, active, shared = self.stack.loop.period_s, self.active, self.sharing_id
        for joint in self.joints:
            name, reported = joint.name, joint.name in state.faults
            self._healthy_s[name] = 0.0 if reported else self._healthy_s[name] + period_s
            if not active or name in shared or self._healthy_s[name] > REMAINS_S or not self._works(joint):
                self._reported_s.pop(name, None)
            elif reported or name in self._reported_s:
                self._reported_s[name] = self._reported_s.get(name, 0.0) + period_s
            self.examined += reported and name in self._reported_s
            if reported and self._reported_s.get(name, 0.0) > TAKEN_BACK_S:
                text = state.faults[name].text
                self.say(f"{name} responds again but is still reported after {TAKEN_BACK_S:g} s: {text}")

    def _works(self, joint: Joint) -> bool:
        """Return whether past faults have left the joint's servo unchanged, with its torque enabled and no alarm."""
        touches = self.stack.touches
        passing = touches.kinds(joint.name) <= PASSING | {"overload"} and touches.since_s(joint.name) > 0.0
        return passing and self.torque(joint) and not self.reports_error(joint)


class MeasuredNow(Invariant):
    """The reported position of a joint without a fault is a position that its servo has had since the last cycle.

    Reporting an older position, the position of another servo, or the command is a violation. Two servos with the same
    ID are skipped, because it is unknown which of them replied. The position of a shaft past the seam of its encoder
    may differ by a whole turn; "reported truly" compares it with the simulated world.
    """

    name = "measured now"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._shared_before = frozenset(joint.name for joint in self.joints)
        self._turns = [joint.model.counts_per_turn for joint in self.joints]
        self._order = [stack.loop.hardware.joints.index(joint.name) for joint in self.joints]
        servos = [servo for line in stack.lines.values() for servo in line.servos]
        self._columns = [servos.index(self.servos[joint.name]) for joint in self.joints]
        self._lines = [(sample, [sample()]) for sample in map(_sampler, stack.lines.values())]
        """For each line, the function that samples the positions of its servos, and their positions in the last cycle
        and after each simulation step since then."""

    def on_step(self, time_s: float) -> None:
        for sample, samples in self._lines:
            samples.append(sample())

    def on_state(self, state: JointState) -> None:
        shared = self.sharing_id
        positions = np.concatenate([_decoded(np.array(samples)) for _, samples in self._lines], axis=1)
        lowest_of, highest_of = positions.min(axis=0)[self._columns], positions.max(axis=0)[self._columns]
        for place, joint in enumerate(self.joints):
            falsified = self.stack.touches.since_s(joint.name, FALSIFYING) <= 0.0
            if joint.name in state.faults or joint.name in shared | self._shared_before or falsified:
                continue
            self.examined += 1
            counts = state.position[self._order[place]] / joint.units_per_count + joint.zero_counts
            lowest, highest = lowest_of[place], highest_of[place]
            beyond = (counts - turns * self._turns[place] for turns in (0, -1, 1))  # A shaft may be past its seam.
            if not any(lowest - SAMPLED_COUNTS <= one <= highest + SAMPLED_COUNTS for one in beyond):
                self.say(f"{joint.name} is reported at {counts:.0f}, but was between {lowest:.0f} and {highest:.0f}")
        self._shared_before = shared
        for _, samples in self._lines:
            del samples[:-1]


def _sampler(line: ServoLine[Any]) -> Callable[[], Any]:
    """Return a function that returns the positions of all servos on a line, as register bytes or in counts.

    It is called every millisecond. If possible, it therefore copies the registers of all servos together.
    """
    servos = list(line.servos)
    if line.rig.tables is not None:
        copied: Callable[[], Any] = line.rig.tables[:, _POSITION].copy
        return copied
    if any(isinstance(servo, VirtualServo) for servo in servos):
        return lambda: [_own_count(servo) for servo in servos]
    # A Dynamixel servo updates its register only when it is read.
    firmwares = [servo.firmware for servo in servos]
    return lambda: [firmware.position for firmware in firmwares]


def _decoded(samples: NDArray[Any]) -> FloatArray:
    """Convert samples to counts, shape (m, n), from counts of the same shape or from register bytes, shape (m, n,
    2)."""
    if samples.ndim == 2:
        return samples
    words = samples.astype(np.int64) @ (1, 256)
    sign = 1 << (sts.present_position.sign_bit or 16)
    return np.where(words < sign, words, sign - words).astype(np.float64)


def _own_count(servo: Any) -> float:
    """Return the position that the servo would report now, in counts."""
    return float(servo.memory.get(sts.present_position) if isinstance(servo, VirtualServo) else servo.firmware.position)


class LimpIsFound(Invariant):
    """A servo that is limp or has been reset is detected within half a second.

    The next goal would enable the torque of a limp servo. If a goal has already enabled the torque of a reset servo,
    the servo drives with its own maximum torque instead of the limit from the robot file. A servo with a temperature
    alarm releases its torque and must not be driven again.
    """

    name = "limp joints are found"
    promised = False

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._since_s: dict[tuple[str, str], float] = {}

    def on_state(self, state: JointState) -> None:
        since_s, self._since_s = self._since_s, {}
        for joint in self.joints if self.active else ():
            how = "" if joint.name in state.faults else self._unfit(joint)
            if not how:
                continue
            self.examined += 1
            key = joint.name, how
            self._since_s[key] = since_s.get(key, state.stamp_s)
            unfit_s = state.stamp_s - self._since_s[key]
            if unfit_s > FOUND_S + 2.0 * self.stack.loop.period_s:
                self.say(f"{joint.name} has been {how} for {unfit_s:.2f} s but is not reported")

    def _unfit(self, joint: Joint) -> str:
        """Return "too hot", "limp" or "reset", or an empty string if the servo drives its motor as configured.

        A limp or reset servo is not examined while a fault affects it. A servo that is too hot is always reported.
        """
        if "temperature" in alarm_names(self.error_bits(joint)):
            return "too hot"
        if self.stack.touches.since_s(joint.name) <= 0.0:
            return ""
        if not self.torque(joint):
            return "limp"
        series, memory = series_of(joint.model), self.servos[joint.name].memory
        own = series.torque_by_goal and series.torque_limit is not None
        return "reset" if own and memory.get(series.torque_limit) == memory.get(series.max_torque) else ""
