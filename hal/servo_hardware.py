"""Serial bus servos as a hardware component: real or virtual, the difference is below the port."""

import logging
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from drivers.bus.bus import Bus
from drivers.bus.retry import ATTEMPTS
from drivers.bus.types import Reading, ServoGoal, ServoState
from drivers.clock import Clock
from drivers.errors import ServoCorrupt, ServoSilent
from hal.errors import ActivationError
from hal.joint import Joint
from hal.joint_buses import JointBuses
from hal.lifecycle import LifecycleState, require, require_configured
from hal.types import JointCommand, JointFault, JointState, ServoHealth

LOG = logging.getLogger("servoloop.hal")

OUTSIDE_TOLERANCE = 0.05
"""How far outside its limits (as a share of their span) a joint may stand when torque goes on."""
INTERPOLATION_MARGIN = 1.05
"""The servo is told to be a little faster than needed, so that what it lags behind is made up."""
INTERPOLATION_FLOOR_COUNTS_S = 20
CATCH_UP_S = 0.5
"""In about this time a servo that lies behind its goal is to be there."""
READ_SHARE = 0.5
"""What share of the period a read may take that nobody gave a deadline."""
WITHHELD_AFTER = 2
"""A servo that was missing for so many cycles gets no goals before it has been asked whether it drives its motor."""
FIRST_PERIOD_S = 0.05
"""The period until a command tells it."""


class ServoHardware:
    """The life cycle of hal.lifecycle.Hardware over one Bus or several.

    ``interpolate`` tells each servo how fast to go, so that it moves through the whole period
    instead of leaping to the goal and waiting there.
    """

    def __init__(
        self,
        name: str,
        joints: Sequence[Joint],
        open_buses: Callable[[], Bus | Mapping[str, Bus]],
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
        self._buses: JointBuses | None = None
        self._clock = clock
        self._period_s = FIRST_PERIOD_S
        self._goals: dict[str, int] = {}
        self._measured: dict[str, int] = {}
        """Counts, of the joints whose servos answered in the last exchange."""
        self._faults: dict[str, JointFault] = {}
        self._missing: dict[str, int] = {}
        """For how many cycles a servo has not answered, until it has shown that it drives its motor."""
        self._requested = False
        self._deadline_s = math.inf
        self._last = self._unknown_state()

    def configure(self) -> None:
        require(self.state, LifecycleState.UNCONFIGURED, "configure")
        opened = self._open_buses()
        buses = opened if isinstance(opened, Mapping) else {self._joints[0].bus: opened}
        self._buses = JointBuses(self._joints, buses)
        self.state = LifecycleState.INACTIVE
        self._faults.clear()
        self._missing.clear()
        self._last = self._unknown_state()
        try:
            self._buses.check()
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
        buses = self._opened("activate")
        self._faults.clear()
        self._missing.clear()
        self._take_goals(self._joints, buses)
        limp = [joint for joint in self._joints if not buses.torque_is_on(joint)]
        try:
            for joint in self._joints:
                buses.limit_torque(joint)
            self._take_goals(self._joints, buses)  # a limp arm has sunk meanwhile
            self._hold_goals(buses)
            for joint in self._joints:
                self._torque_on(buses, joint)
        except BaseException:
            for problem in buses.torque_off(limp):
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
        if self._buses is not None:
            self._buses.close()
            self._buses = None

    def request(self, deadline_s: float | None = None) -> None:
        """Ask all servos for their states, on all buses."""
        buses = self._opened("read")
        self._deadline_s = self._clock.now() + READ_SHARE * self._period_s if deadline_s is None else deadline_s
        buses.request(self._deadline_s)
        self._requested = True

    def read(self) -> JointState:
        """What the servos have answered by the deadline. A silent servo keeps its last values and is named."""
        if not self._requested:
            self.request()
        self._requested = False
        return self._take(self._opened("read").receive())

    def _take(self, readings: Mapping[str, Reading]) -> JointState:
        position, velocity = self._last.position.copy(), self._last.velocity.copy()
        effort = self._last.effort.copy()
        health = dict(self._last.health)
        buses = self._opened("read")
        counters = buses.counters()
        self._measured.clear()
        for index, joint in enumerate(self._joints):
            reading = readings[joint.name]
            self._note_fault(joint, reading)
            account = counters[joint.bus].of(joint.servo_id)
            if isinstance(reading, ServoState):
                self._measured[joint.name] = reading.position_counts
                position[index] = joint.position(reading.position_counts)
                velocity[index] = reading.velocity_counts_s * joint.units_per_count
                effort[index] = reading.load * joint.full_effort * joint.sign
                load = reading.load * joint.sign
                current_a = math.nan if reading.current_a is None else reading.current_a * joint.sign
                health[joint.name] = ServoHealth(
                    reading.voltage_v, reading.temperature_c, reading.alarms, account, load, current_a
                )
            elif joint.name in health:  # what is counted of a silent servo goes on
                health[joint.name] = replace(health[joint.name], counters=account)
        if self.state is LifecycleState.ACTIVE:
            self._rejoin()
        lines = {buses.port(name): account for name, account in counters.items()}
        self._last = JointState(
            self._clock.now(), position, velocity, effort, self._present_faults(), health, lines=lines
        )
        return self._last

    def _present_faults(self) -> dict[str, JointFault]:
        """A servo that answers again is no fault, whether it has been asked for its torque already or not."""
        return {
            name: fault
            for name, fault in self._faults.items()
            if name not in self._measured or fault.kind == "no_torque"
        }

    def write(self, command: JointCommand) -> None:
        """One packet a bus with a goal for each of its servos; the command has passed the safety gate.

        A servo that was missing for longer than a lost reply gets none before it has shown that it still drives its
        motor: one that was reset would take a goal for the order to switch its torque on.
        """
        require(self.state, LifecycleState.ACTIVE, "write")
        self._period_s = command.period_s
        goals: dict[str, ServoGoal] = {}
        for joint, position in zip(self._joints, command.values, strict=True):
            if self._missing.get(joint.name, 0) >= WITHHELD_AFTER:
                continue
            reach = math.ceil(joint.limits.velocity * command.period_s / abs(joint.units_per_count))
            held = self._goals[joint.name]
            # A joint that began outside its limits has a goal there, and must not leap back in.
            counts = min(max(joint.counts(float(position)), held - reach), held + reach)
            goals[joint.name] = ServoGoal(counts, self._speed(joint, counts, reach))
        # Before they are sent: where one bus is lost, the servos on the others have theirs nevertheless.
        self._goals |= {name: goal.position_counts for name, goal in goals.items()}
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

    def _opened(self, what: str) -> JointBuses:
        require_configured(self.state, what)
        assert self._buses is not None
        return self._buses

    def _measure_all(self, buses: JointBuses) -> dict[str, ServoState]:
        readings = buses.measure()
        silent = [
            f"{buses.label(joint)}: {reading.text}"
            for joint in self._joints
            if not isinstance(reading := readings[joint.name], ServoState)
        ]
        if silent:
            raise ActivationError("not activated: " + "; ".join(silent))
        self._deadline_s = math.inf
        self._take(readings)
        return {name: reading for name, reading in readings.items() if isinstance(reading, ServoState)}

    def _take_goals(self, joints: Sequence[Joint], buses: JointBuses) -> None:
        """Make the measured positions the goals of these joints. Raises ActivationError where one must not be held."""
        measured = self._measure_all(buses)
        self._goals |= {joint.name: self._start_goal(joint, measured[joint.name]) for joint in joints}

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

    def _hold_goals(self, buses: JointBuses) -> None:
        """Nobody acknowledges goals: ask each servo whether it has its own. One packet that was lost is not the end."""
        goals = {name: ServoGoal(counts) for name, counts in self._goals.items()}
        for _ in range(ATTEMPTS):
            buses.write_goals(goals)
            wrong = [joint for joint in self._joints if buses.goal(joint) != self._goals[joint.name]]
            if not wrong:
                return
        self._confirm_goal(buses, wrong[0])

    def _confirm_goal(self, buses: JointBuses, joint: Joint) -> None:
        held, wanted = buses.goal(joint), self._goals[joint.name]
        if held != wanted:
            raise ActivationError(
                f"not activated: {self._called(joint)} holds goal {held}, not {wanted}: check the cable and the supply"
            )

    def _torque_on(self, buses: JointBuses, joint: Joint) -> None:
        """Where no acknowledgement comes the servo may have been reset: only one that has its goal still is told again.

        That takes time, in which limp joints may move: those that have no torque yet are measured once more.
        """
        later = self._joints[self._joints.index(joint) :]
        for _ in range(ATTEMPTS - 1):
            try:
                buses.torque_on(joint)
                return
            except (ServoSilent, ServoCorrupt):
                self._confirm_goal(buses, joint)
                self._take_goals(later, buses)
                buses.limit_torque(joint)
                self._hold_goals(buses)
        buses.torque_on(joint)

    def _called(self, joint: Joint) -> str:
        return f"{self._opened('name a joint').label(joint)} (servo {joint.servo_id})"

    def _note_fault(self, joint: Joint, reading: Reading) -> None:
        if not isinstance(reading, ServoState):
            fault = JointFault(reading.kind, reading.text)
            if joint.name not in self._faults and fault not in self._faults.values():  # a line's is told once
                LOG.error("%s", fault.text)
            self._faults[joint.name] = fault
            self._missing[joint.name] = self._missing.get(joint.name, 0) + 1
        elif joint.name in self._faults and self.state is not LifecycleState.ACTIVE:
            self._forget_fault(joint)

    def _forget_fault(self, joint: Joint) -> None:
        self._faults.pop(joint.name, None)
        self._missing.pop(joint.name, None)

    def _rejoin(self) -> None:
        """Take back all that were missing and answer again; whoever there is no time to ask waits for the next cycle.

        A servo that lost its power comes back limp, and its goal is not ours any more.
        """
        back = [joint for joint in self._joints if joint.name in self._faults and joint.name in self._measured]
        if not back:
            return
        buses = self._opened("read")
        for joint_name, driven in buses.torque_states(back, self._deadline_s).items():
            joint = next(joint for joint in back if joint.name == joint_name)
            if driven:
                LOG.warning("%s: servo %d answers again", buses.label(joint), joint.servo_id)
                self._forget_fault(joint)
            else:
                self._refuse_limp(joint)

    def _refuse_limp(self, joint: Joint) -> None:
        label = self._opened("read").label(joint)
        text = f"{label}: servo {joint.servo_id} came back without torque (power dip?): activate again"
        if self._faults[joint.name].kind != "no_torque":
            LOG.error("%s", text)
        self._faults[joint.name] = JointFault("no_torque", text)
        self._missing[joint.name] = WITHHELD_AFTER

    def _unknown_state(self) -> JointState:
        unknown = np.full(len(self._joints), np.nan)
        return JointState(self._clock.now(), unknown, unknown, unknown)
