"""Serial bus servos as a hardware component: real or virtual, the difference is below the port."""

import logging
import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from drivers.bus import Reading, ServoBus, ServoGoal, ServoState
from drivers.clock import Clock
from drivers.errors import ServoCorrupt, ServoError, ServoSilent
from drivers.tries import ATTEMPTS
from drivers.turns import Steps, finish
from hal.errors import ActivationError
from hal.joint import Joint
from hal.lifecycle import LifecycleState, require, require_configured
from hal.lines import Lines
from hal.types import JointCommand, JointState, ServoHealth

LOG = logging.getLogger("servoloop.hal")

OUTSIDE_TOLERANCE = 0.05
"""How far outside its limits (as a share of their span) a joint may stand when torque goes on."""
INTERPOLATION_MARGIN = 1.05
"""The servo is told to be a little faster than needed, so that what it lags behind is made up."""
INTERPOLATION_FLOOR_COUNTS_S = 20
CATCH_UP_S = 0.5
"""In about this time a servo that lies behind its goal is to be there."""
READ_SHARE = 0.5
"""What share of the period reading may take, lost replies and second questions included."""
FIRST_PERIOD_S = 0.05
"""The period until a command tells it."""


class ServoHardware:
    """The life cycle of hal.lifecycle.Hardware over one ServoBus or several.

    ``interpolate`` tells each servo how fast to go, so that it moves through the whole period
    instead of leaping to the goal and waiting there.
    """

    def __init__(
        self,
        name: str,
        joints: Sequence[Joint],
        open_buses: Callable[[], ServoBus | Mapping[str, ServoBus]],
        clock: Clock,
    ) -> None:
        """``open_buses`` returns the buses by the names that the joints give; or just the one there is."""
        self.name = name
        self.joints = tuple(joint.name for joint in joints)
        self.command_interfaces = tuple(f"{joint.name}/position" for joint in joints)
        self.state = LifecycleState.UNCONFIGURED
        self.interpolate = True
        self._joints = tuple(joints)
        self._open_buses = open_buses
        self._lines: Lines | None = None
        self._clock = clock
        self._period_s = FIRST_PERIOD_S
        self._goals: dict[str, int] = {}
        self._measured: dict[str, int] = {}
        """Counts, of the joints whose servos answered in the last exchange."""
        self._faults: dict[str, str] = {}
        self._last = self._unknown_state()

    def configure(self) -> None:
        require(self.state, LifecycleState.UNCONFIGURED, "configure")
        opened = self._open_buses()
        buses = opened if isinstance(opened, Mapping) else {self._joints[0].bus: opened}
        self._lines = Lines(self._joints, buses)
        self.state = LifecycleState.INACTIVE
        self._faults.clear()
        self._last = self._unknown_state()
        try:
            self._lines.check()
            self.read()
        except BaseException:
            self.cleanup()
            raise

    def activate(self) -> None:
        """Every goal at its measured position, on all buses and confirmed; only then torque, joint by joint.

        Where that fails, the servos that were limp before are limp again; one that a former program
        left under torque goes on holding: letting go would drop the arm.
        """
        require(self.state, LifecycleState.INACTIVE, "activate")
        lines = self._opened("activate")
        self._faults.clear()
        measured = self._measure_all(lines)
        limp = [joint for joint in self._joints if not lines.torque_is_on(joint)]
        self._goals = {joint.name: self._start_goal(joint, measured[joint.name]) for joint in self._joints}
        try:
            for joint in self._joints:
                lines.limit_torque(joint)
            self._hold_goals(lines)
            for joint in self._joints:
                self._torque_on(lines, joint)
        except BaseException:
            for problem in lines.torque_off(limp):
                LOG.error("torque may still be on: %s", problem)
            raise
        self.state = LifecycleState.ACTIVE
        self.read()

    def deactivate(self, relax: bool) -> Sequence[str]:
        require(self.state, LifecycleState.ACTIVE, "deactivate")
        self.state = LifecycleState.INACTIVE
        return self._opened("deactivate").torque_off(self._joints) if relax else []

    def cleanup(self) -> None:
        self.state = LifecycleState.UNCONFIGURED
        if self._lines is not None:
            self._lines.close()
            self._lines = None

    def read(self) -> JointState:
        """One exchange with all servos. A silent servo keeps its last values and is named."""
        return finish(self.reading())

    def reading(self) -> Steps[JointState]:
        """``read`` in steps: it yields when all questions are out."""
        lines = self._opened("read")
        deadline_s = self._clock.now() + READ_SHARE * self._period_s
        readings = yield from lines.reading(deadline_s)
        return self._take(readings, deadline_s)

    def _take(self, readings: Mapping[str, Reading], deadline_s: float) -> JointState:
        position, velocity = self._last.position.copy(), self._last.velocity.copy()
        effort = self._last.effort.copy()
        health = dict(self._last.health)
        lines = self._opened("read")
        self._measured.clear()
        for index, joint in enumerate(self._joints):
            reading = readings[joint.name]
            self._note_fault(joint, reading)
            if isinstance(reading, ServoState):
                self._measured[joint.name] = reading.position_counts
                position[index] = joint.position(reading.position_counts)
                velocity[index] = reading.velocity_counts_s * joint.units_per_count
                effort[index] = reading.load * joint.full_effort * joint.sign
                account = lines.counters(joint)
                load = reading.load * joint.sign
                current_a = math.nan if reading.current_a is None else reading.current_a * joint.sign
                health[joint.name] = ServoHealth(
                    reading.voltage_v, reading.temperature_c, reading.alarms, account, load, current_a
                )
        if self.state is LifecycleState.ACTIVE:
            self._welcome_one_back(deadline_s)
        self._last = JointState(
            self._clock.now(), position, velocity, effort, dict(self._faults), health, lines=lines.accounts
        )
        return self._last

    def write(self, command: JointCommand) -> None:
        """One packet a bus with a goal for each of its servos; the command has passed the safety gate."""
        require(self.state, LifecycleState.ACTIVE, "write")
        self._period_s = command.period_s
        goals: dict[str, ServoGoal] = {}
        for joint, position in zip(self._joints, command.values, strict=True):
            reach = math.ceil(joint.limits.velocity * command.period_s / abs(joint.units_per_count))
            held = self._goals[joint.name]
            # A joint that began outside its limits has a goal there, and must not leap back in.
            counts = min(max(joint.counts(float(position)), held - reach), held + reach)
            goals[joint.name] = ServoGoal(counts, self._speed(joint, counts, reach))
        # Before they are sent: where one bus is lost, the servos on the others have theirs nevertheless.
        self._goals = {name: goal.position_counts for name, goal in goals.items()}
        self._opened("write").write_goals(goals)

    def _speed(self, joint: Joint, counts: int, reach: int) -> int:
        """Counts/s. ``reach``: counts that the joint may go in one period.

        As fast as the way from the last goal needs. Where a servo lies behind (it was silent, or
        something was in its way), it catches up in ``CATCH_UP_S``, within the joint's velocity limit.
        Without interpolation a servo is let loose (0) only when it is known to be near its goal.
        """
        held = self._goals[joint.name]
        measured = self._measured.get(joint.name)
        if not self.interpolate and measured is not None and abs(held - measured) <= reach:
            return 0
        speed = abs(counts - held) / self._period_s * INTERPOLATION_MARGIN + INTERPOLATION_FLOOR_COUNTS_S
        if measured is not None:
            limit = joint.limits.velocity / abs(joint.units_per_count)
            speed = max(speed, min(abs(counts - measured) / CATCH_UP_S, limit))
        return min(round(speed), 32767)

    def _opened(self, what: str) -> Lines:
        require_configured(self.state, what)
        assert self._lines is not None
        return self._lines

    def _measure_all(self, lines: Lines) -> dict[str, ServoState]:
        readings = lines.measure()
        silent = [
            f"{lines.label(joint)}: {reading.text}"
            for joint in self._joints
            if not isinstance(reading := readings[joint.name], ServoState)
        ]
        if silent:
            raise ActivationError("not activated: " + "; ".join(silent))
        self._take(readings, math.inf)
        return {name: reading for name, reading in readings.items() if isinstance(reading, ServoState)}

    def _start_goal(self, joint: Joint, state: ServoState) -> int:
        """The measured position, if it lies within the limits or (by play, a soft stop) almost."""
        position = joint.position(state.position_counts)
        lower, upper = joint.limits.lower, joint.limits.upper
        slack = OUTSIDE_TOLERANCE * (upper - lower)
        if not lower - slack <= position <= upper + slack:
            raise ActivationError(
                f"not activated: {self._called(joint)} stands at {position:.4f}, outside "
                f"its limits {lower:.4f} to {upper:.4f}. Move it by hand, or correct zero_counts"
            )
        return state.position_counts

    def _hold_goals(self, lines: Lines) -> None:
        """Nobody acknowledges goals: ask each servo whether it has its own. One packet that was lost is not the end."""
        goals = {name: ServoGoal(counts) for name, counts in self._goals.items()}
        for _ in range(ATTEMPTS):
            lines.write_goals(goals)
            wrong = [joint for joint in self._joints if lines.goal(joint) != self._goals[joint.name]]
            if not wrong:
                return
        self._confirm_goal(lines, wrong[0])

    def _confirm_goal(self, lines: Lines, joint: Joint) -> None:
        held, wanted = lines.goal(joint), self._goals[joint.name]
        if held != wanted:
            raise ActivationError(
                f"not activated: {self._called(joint)} holds goal {held}, not {wanted}: check the cable and the supply"
            )

    def _torque_on(self, lines: Lines, joint: Joint) -> None:
        """Where no acknowledgement comes the servo may have been reset: only one that has its goal still is told again.

        That takes time, in which limp joints may move: those that have no torque yet are measured once more.
        """
        later = self._joints[self._joints.index(joint) :]
        for _ in range(ATTEMPTS - 1):
            try:
                lines.torque_on(joint)
                return
            except (ServoSilent, ServoCorrupt):
                self._confirm_goal(lines, joint)
                measured = self._measure_all(lines)
                self._goals |= {each.name: self._start_goal(each, measured[each.name]) for each in later}
                lines.limit_torque(joint)
                self._hold_goals(lines)
        lines.torque_on(joint)

    def _called(self, joint: Joint) -> str:
        return f"{self._opened('name a joint').label(joint)} (servo {joint.servo_id})"

    def _note_fault(self, joint: Joint, reading: Reading) -> None:
        if not isinstance(reading, ServoState):
            label = self._opened("read").label(joint)
            if joint.name not in self._faults:
                LOG.error("%s: %s", label, reading.text)
            self._faults[joint.name] = f"{label}: {reading.text}"
        elif joint.name in self._faults and self.state is not LifecycleState.ACTIVE:
            del self._faults[joint.name]

    def _welcome_one_back(self, deadline_s: float) -> None:
        """Of those that were away and answer again, whoever has waited longest: a cycle has no time for all."""
        name = next((name for name in self._faults if name in self._measured), None)
        if name is not None:
            self._faults[name] = self._faults.pop(name)  # to the end of the queue, should it remain
            self._welcome_back(next(joint for joint in self._joints if joint.name == name), deadline_s)

    def _welcome_back(self, joint: Joint, deadline_s: float) -> None:
        """A servo that lost its power comes back limp, and its goal is not ours any more."""
        lines = self._opened("read")
        try:
            driven = lines.torque_is_on(joint, deadline_s)
        except ServoError:
            return
        if driven:
            LOG.warning("%s: servo %d answers again", lines.label(joint), joint.servo_id)
            del self._faults[joint.name]
            return
        text = f"servo {joint.servo_id} came back without torque (power dip?): activate again"
        if text not in self._faults[joint.name]:
            LOG.error("%s: %s", lines.label(joint), text)
        self._faults[joint.name] = f"{lines.label(joint)}: {text}"

    def _unknown_state(self) -> JointState:
        unknown = np.full(len(self._joints), np.nan)
        return JointState(self._clock.now(), unknown, unknown, unknown)
