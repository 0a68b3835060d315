"""The activation of servos: every goal at its measured position, on all buses and confirmed; only then the torque."""

import logging
from collections.abc import Callable, Mapping, Sequence
from typing import Final

from drivers.bus.retry import ATTEMPTS
from drivers.bus.types import Reading, ServoGoal, ServoState
from drivers.clock import Clock
from drivers.errors import ServoCorrupt, ServoSilent
from hal.errors import ActivationError
from hal.joint import Joint
from hal.servos.joint_buses import JointBuses
from hal.servos.servo_setup import ServoSetup
from hal.types import far_outside

LOG = logging.getLogger("servoloop.hal")

CONFIRMING_READS: Final = 8
"""Number of readings among which two in a row must agree before a measured position becomes a goal."""
AGREE_S: Final = 0.01
"""Two readings agree if they differ by no more than the joint moves in this time at its velocity limit."""
AGREE_COUNTS: Final = 3
"""Smallest difference at which two readings still agree: the noise of an encoder."""
FRESH_S: Final = 0.1
"""Age at which a measured goal is measured again before the torque goes on: limp joints sink meanwhile."""


class Activation:
    """One activation of a component's servos; ``run`` raises where one of them must not have torque."""

    def __init__(
        self,
        joints: Sequence[Joint],
        buses: JointBuses,
        clock: Clock,
        measured: Callable[[Mapping[str, Reading]], object],
    ) -> None:
        """``measured`` is given each measurement of all joints on the way."""
        self._joints = tuple(joints)
        self._buses = buses
        self._setup = ServoSetup(buses)
        self._clock, self._measured = clock, measured
        self._measured_s = 0.0
        self._goals: dict[str, int] = {}
        self._limp: list[Joint] = []

    def run(self) -> dict[str, int]:
        """Switch the torque on, joint by joint; returns the goals that are held, in counts by joint name.

        Where that fails, the servos that were limp before are limp again; one that a former program
        left under torque goes on holding: letting go would drop the arm.
        """
        self._measure_all()  # a silent servo is named here at once: the check would look for it at all baud rates
        if problems := self._setup.problems():
            raise ActivationError("not activated: " + "; ".join(problems))
        self._take_goals(self._joints)
        self._limp = [joint for joint in self._joints if not self._setup.torque_is_on(joint)]
        for joint in self._joints:
            if joint not in self._limp:
                self._check_turn(joint)
        self._setup.forget_turns(self._limp)
        try:
            for joint in self._joints:
                self._setup.limit_torque(joint)
            self._take_goals(self._joints)  # a limp arm has sunk meanwhile
            self._hold_goals()
            for joint in self._joints:
                self._torque_on(joint)
        except BaseException:
            self.let_go()
            raise
        return self._goals

    def let_go(self) -> None:
        """Make those limp again that were limp before."""
        for problem in self.undo():
            LOG.error("torque may still be on: %s", problem)

    def undo(self) -> list[str]:
        """Make those limp again that were limp before; returns what failed."""
        return self._setup.torque_off(self._limp)

    def _take_goals(self, joints: Sequence[Joint]) -> None:
        """Make the measured positions the goals of these joints. Raises ActivationError where one must not be held."""
        states = self._confirmed()
        self._goals |= {joint.name: self._start_goal(joint, states[joint.name]) for joint in joints}

    def _confirmed(self) -> dict[str, ServoState]:
        """States whose positions two readings in a row agree on: a reply with false data can have a right checksum."""
        last = self._measure_all()
        for _ in range(CONFIRMING_READS - 1):
            before, last = last, self._measure_all()
            apart = [joint for joint in self._joints if not _agree(joint, before[joint.name], last[joint.name])]
            if not apart:
                return last
        joint = apart[0]
        raise ActivationError(
            f"not activated: {self._called(joint)} reports {before[joint.name].position_counts} and then "
            f"{last[joint.name].position_counts} counts: hold the arm still, and check the servo's cable"
        )

    def _measure_all(self) -> dict[str, ServoState]:
        self._measured_s = self._clock.now()
        readings = self._setup.measure()
        silent = [
            f"{self._buses.label(joint)}: {reading.text}"
            for joint in self._joints
            if not isinstance(reading := readings[joint.name], ServoState)
        ]
        if silent:
            raise ActivationError("not activated: " + "; ".join(silent))
        self._measured(readings)
        return {name: reading for name, reading in readings.items() if isinstance(reading, ServoState)}

    def _start_goal(self, joint: Joint, state: ServoState) -> int:
        """The measured position, if it lies within the limits or (by play, a soft stop) almost."""
        position = joint.position(state.position_counts)
        lower, upper = joint.limits.lower, joint.limits.upper
        if problem := far_outside(position, joint.limits):
            if counted_turns(joint, state.position_counts):
                raise ActivationError(
                    f"not activated: {self._called(joint)} {problem}. {counted_turns(joint, state.position_counts)}"
                )
            raise ActivationError(
                f"not activated: {self._called(joint)} {problem}. Move it by hand, or correct zero_counts"
            )
        if not lower <= position <= upper:
            self._check_own_limits(joint, state.position_counts)
        return state.position_counts

    def _check_own_limits(self, joint: Joint, counts: int) -> None:
        """Within the joint's limits the set-up has seen to it. Beyond its own a servo drives to them at once."""
        limits = self._setup.position_limits(joint)
        if limits is not None and not limits[0] <= counts <= limits[1]:
            raise ActivationError(
                f"not activated: {self._called(joint)} is at {counts} counts, outside the servo's own limits "
                f"{limits[0]} to {limits[1]}, and would drive there at once. Move it by hand, or widen them"
            )

    def _check_turn(self, joint: Joint) -> None:
        """A servo that holds a goal far from what it reports counts turns, and would take any goal for one of another.

        What it reports may be the place within the turn alone; only limp servos can be made to forget the others.
        """
        held, measured = self._setup.goal(joint), self._goals[joint.name]
        if abs(held - measured) > joint.model.counts_per_turn // 2:
            raise ActivationError(
                f"not activated: {self._called(joint)} is held at {held} counts and reports {measured}, as one that is "
                "held a turn away. Hold the arm, and switch the servos' supply off and on"
            )

    def _hold_goals(self) -> None:
        """Nobody acknowledges goals: ask each servo whether it has its own. One packet that was lost is not the end.

        Most servos switch their torque on when they are told a goal: it must not be an old one.
        """
        for _ in range(ATTEMPTS):
            self._buses.write_goals({name: ServoGoal(counts) for name, counts in self._goals.items()})
            wrong = [joint for joint in self._joints if self._setup.goal(joint) != self._goals[joint.name]]
            if not wrong:
                return
            if self._old():
                self._take_goals([joint for joint in wrong if not self._setup.torque_is_on(joint)])
        self._confirm_goal(wrong[0])

    def _confirm_goal(self, joint: Joint) -> None:
        held, wanted = self._setup.goal(joint), self._goals[joint.name]
        if held != wanted:
            raise ActivationError(
                f"not activated: {self._called(joint)} holds goal {held}, not {wanted}: check the cable and the supply"
            )

    def _torque_on(self, joint: Joint) -> None:
        """Where no acknowledgement comes the servo may have been reset: only one that has its goal still is told again.

        That takes time, in which limp joints may move: they are measured once more.
        """
        for _ in range(ATTEMPTS - 1):
            self._renew_goals(joint)
            try:
                self._setup.torque_on(joint)
                return
            except (ServoSilent, ServoCorrupt):
                self._confirm_goal(joint)
                self._retake_goals(joint)
        self._renew_goals(joint)
        self._setup.torque_on(joint)

    def _renew_goals(self, joint: Joint) -> None:
        """Measure again where that was too long ago. A slow line may never be quick enough: the last goals hold."""
        for _ in range(ATTEMPTS):
            if not self._old():
                return
            self._retake_goals(joint)

    def _old(self) -> bool:
        return self._clock.now() - self._measured_s > FRESH_S

    def _retake_goals(self, joint: Joint) -> None:
        """Measure the joints that are limp still, from this one on, and hold them there.

        The others keep the goals that they were switched on with: a joint that gives way a little must not give way
        again with every lost packet.
        """
        later = self._joints[self._joints.index(joint) :]
        self._take_goals([one for one in later if not self._setup.torque_is_on(one)])
        self._setup.limit_torque(joint)
        self._hold_goals()

    def _called(self, joint: Joint) -> str:
        return f"{self._buses.label(joint)} (servo {joint.servo_id})"


def counted_turns(joint: Joint, counts: int) -> str:
    """Explain a reading that lies whole turns away from the servo's counts; empty if it is one of them."""
    if not (turns := joint.turns(counts)):
        return ""
    number = "a turn" if abs(turns) == 1 else f"{abs(turns)} turns"
    return (
        f"The servo reports {counts} counts, which is outside 0 to {joint.model.last_count}: it has counted {number}. "
        "Hold the arm, and switch the servos' supply off and on. Leave the zero as it is: a changed one would be wrong "
        "afterwards"
    )


def _agree(joint: Joint, one: ServoState, other: ServoState) -> bool:
    way = joint.limits.velocity * AGREE_S / abs(joint.units_per_count)
    return abs(one.position_counts - other.position_counts) <= max(AGREE_COUNTS, way)
