"""Activate servos: set every goal to its measured position, read it back on all buses, and then enable torque."""

import logging
from collections.abc import Callable, Mapping, Sequence
from typing import Final

from drivers.bus.retry import ATTEMPTS
from drivers.clock import Clock
from drivers.driver_errors import ServoCorrupt, ServoSilent
from drivers.types import Reading, ServoGoal, ServoState
from hal.hal_errors import ActivationError
from hal.joint import Joint
from hal.servos.joint_buses import JointBuses
from hal.servos.servo_setup import ServoSetup
from hal.servos.start_goal import start_goal

LOG = logging.getLogger("servoloop.hal")

CONFIRMING_READS: Final = 8
"""Maximum number of readings to take until two consecutive readings agree and the measured position becomes the
goal."""
AGREE_S: Final = 0.01
"""Maximum difference between two readings that agree, expressed as the travel time at the joint's velocity limit, in
seconds."""
AGREE_COUNTS: Final = 3
"""Maximum difference between two readings that is always attributed to encoder noise, in counts."""
FRESH_S: Final = 0.1
"""Maximum age of a measurement at the time torque is enabled, in seconds. An older measurement is repeated, because a
limp joint may have dropped in the meantime.
"""


class Activation:
    """One activation of the servos of a component."""

    def __init__(
        self,
        joints: Sequence[Joint],
        buses: JointBuses,
        clock: Clock,
        measured: Callable[[Mapping[str, Reading]], object],
        restarted: Callable[[], object] = lambda: None,
    ) -> None:
        """Prepare an activation.

        Args:
            joints: Joints to activate.
            buses: Buses to which the joints belong.
            clock: Clock of the control loop.
            measured: Function that is called with each measurement of all joints.
            restarted: Function that is called after servos have been restarted, because their positions may have
                changed.
        """
        self._joints = tuple(joints)
        self._buses = buses
        self._setup = ServoSetup(buses)
        self._clock, self._measured, self._restarted = clock, measured, restarted
        self._measured_s = 0.0
        self._goals: dict[str, int] = {}
        self._limp: list[Joint] = []
        self.torque_left: tuple[str, ...] = ()
        """Errors of servos whose torque may still be enabled after the activation has failed."""

    def run(self) -> dict[str, int]:
        """Enable torque joint by joint.

        If the activation fails, the torque of servos that were limp before is disabled again. Servos whose torque was
        already enabled continue to hold their positions, because otherwise the arm would fall.

        Returns:
            The goals that the servos hold, in counts, keyed by joint name.

        Raises:
            ActivationError: A servo's torque must not be enabled now.
            DriverError: A servo could not be reached.
        """
        states = (
            self._measure_all()
        )  # reports a silent servo immediately; the check below would search for it at all baud rates
        if problems := self._setup.problems():
            raise ActivationError("not activated: " + "; ".join(problems))
        self._restart_turned(states)
        self._take_goals(self._joints)
        self._limp = [joint for joint in self._joints if not self._setup.torque_is_on(joint)]
        for joint in self._joints:
            if joint not in self._limp:
                self._check_turn(joint)
        self._setup.forget_turns(self._limp)
        try:
            for joint in self._joints:
                self._setup.limit_torque(joint)
                self._setup.prepare_torque(joint)
            self._take_fresh_goals(self._joints)  # a limp arm may have dropped in the meantime
            self._hold_goals()
            for joint in self._joints:
                self._torque_on(joint)
        except BaseException:
            self.release()
            raise
        return self._goals

    def release(self) -> None:
        """Disable the torque of servos that were limp before the activation. Keep and log the errors."""
        self.torque_left = tuple(self.undo())
        for problem in self.torque_left:
            LOG.error("torque may still be on: %s", problem)

    def undo(self) -> list[str]:
        """Disable the torque of servos that were limp before the activation. Return the errors."""
        return self._setup.torque_off(self._limp)

    def _restart_turned(self, states: Mapping[str, ServoState]) -> None:
        """Restart limp servos that have counted whole turns, and repeat this if an instruction was lost."""
        for _ in range(ATTEMPTS):
            restarted = [
                self._setup.restart_turned(joint, states[joint.name].position_counts, self._clock)
                for joint in self._joints
            ]
            if not any(restarted):
                return
            self._restarted()
            states = self._measure_all()

    def _take_goals(self, joints: Sequence[Joint]) -> None:
        """Use the measured joint positions as goals. Raises ActivationError if the arm must not hold a position."""
        states = self._confirmed()
        for joint in joints:
            counts, limp = states[joint.name].position_counts, joint in self._limp
            self._goals[joint.name] = start_goal(joint, counts, self._called(joint), self._setup, limp)

    def _take_fresh_goals(self, joints: Sequence[Joint]) -> None:
        """Measure goals until they are recent enough to be written.

        Each measurement is followed by checks of the joints. If these checks take so long that the measurement becomes
        too old, the goals are measured again. After several attempts on a slow bus, the last measurement is used.
        """
        for _ in range(ATTEMPTS):
            self._take_goals(joints)
            if not self._old():
                return

    def _confirmed(self) -> dict[str, ServoState]:
        """Measure until two consecutive readings agree, because a corrupt reply may have a valid checksum."""
        last = self._measure_all()
        for _ in range(CONFIRMING_READS - 1):
            before, last = last, self._measure_all()
            apart = [joint for joint in self._joints if not _agree(joint, before[joint.name], last[joint.name])]
            if not apart:
                return last
        joint = apart[0]
        raise ActivationError(
            f"not activated: two readings of {self._called(joint)} differ ({before[joint.name].position_counts}, then "
            f"{last[joint.name].position_counts} counts). Hold the arm still and check the servo's cable"
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

    def _check_turn(self, joint: Joint) -> None:
        """Check that a servo whose torque is enabled is not holding its position in a different turn.

        Such a servo reports only its position within one turn, and would move by whole turns to reach a new goal. Only
        a limp servo can be made to discard its turns.
        """
        held, measured = self._setup.goal(joint), self._goals[joint.name]
        if abs(held - measured) > joint.model.counts_per_turn // 2:
            raise ActivationError(
                f"not activated: {self._called(joint)} has goal {held} but reports {measured} counts: it is in "
                "a different turn, or another program enabled its torque without a goal. Hold the arm, and switch the "
                "servos' supply off and on"
            )

    def _hold_goals(self) -> None:
        """Write the goals and read them back, because servos do not acknowledge goals.

        Writing and reading are repeated if a packet was lost. Most servos enable torque when they receive a goal, so
        the goals must be recent. Limp joints are measured again even if their goals agree. A servo that was reset uses
        its position at the restart as its goal, and its joint may have dropped since then.
        """
        for _ in range(ATTEMPTS):
            self._buses.write_goals({name: ServoGoal(counts) for name, counts in self._goals.items()})
            wrong = [joint for joint in self._joints if self._setup.goal(joint) != self._goals[joint.name]]
            if not wrong:
                return
            if self._old():
                self._take_fresh_goals([joint for joint in self._joints if not self._setup.torque_is_on(joint)])
        self._write_alone(wrong)

    def _write_alone(self, joints: Sequence[Joint]) -> None:
        """Write goals with single requests, because these servos may not support group writes."""
        self._setup.write_goals_alone(joints)
        self._buses.write_goals({joint.name: ServoGoal(self._goals[joint.name]) for joint in joints})
        wrong = [joint for joint in joints if self._setup.goal(joint) != self._goals[joint.name]]
        if wrong:
            self._setup.write_goals_alone(wrong, alone=False)
            self._confirm_goal(wrong[0])
        self._measure_all()  # logs the highest rate that is possible with single writes

    def _confirm_goal(self, joint: Joint) -> None:
        held, wanted = self._setup.goal(joint), self._goals[joint.name]
        if held != wanted:
            raise ActivationError(
                f"not activated: {self._called(joint)} has goal {held} instead of {wanted}. Check the cable and the "
                "supply"
            )

    def _torque_on(self, joint: Joint) -> None:
        """Enable the torque of a joint.

        If the servo does not acknowledge the request, retry only if it still has its goal. A servo that does not have
        its goal may have been reset. Limp joints may have moved in the meantime and are measured again.
        """
        for _ in range(ATTEMPTS - 1):
            self._renew_goals(joint)
            try:
                self._setup.torque_on(joint)
                return
            except (ServoSilent, ServoCorrupt):
                self._confirm_goal(joint)
                self._setup.prepare_torque(joint)
                self._retake_goals(joint)
        self._renew_goals(joint)
        self._setup.torque_on(joint)

    def _renew_goals(self, joint: Joint) -> None:
        """Measure again if the last measurement is too old. On a slow bus, the last of several measurements is used."""
        for _ in range(ATTEMPTS):
            if not self._old():
                return
            self._retake_goals(joint)

    def _old(self) -> bool:
        return self._clock.now() - self._measured_s > FRESH_S

    def _retake_goals(self, joint: Joint) -> None:
        """Measure this joint and all later joints that are still limp, and use their positions as goals.

        Joints whose torque is enabled keep their goals. Otherwise a joint that sags under load would sag further with
        every lost packet.
        """
        later = self._joints[self._joints.index(joint) :]
        self._setup.limit_torque(joint)
        self._take_fresh_goals([one for one in later if not self._setup.torque_is_on(one)])
        self._hold_goals()

    def _called(self, joint: Joint) -> str:
        return f"{self._buses.label(joint)} (servo {joint.servo_id})"


def _agree(joint: Joint, one: ServoState, other: ServoState) -> bool:
    travel = joint.limits.velocity * AGREE_S / abs(joint.units_per_count)
    return abs(one.position_counts - other.position_counts) <= max(AGREE_COUNTS, travel)
