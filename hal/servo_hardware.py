"""Serial bus servos as a hardware component: real or virtual, the difference is below the port."""

import logging
import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from drivers.bus import Reading, ServoBus, ServoGoal, ServoState
from drivers.clock import Clock
from drivers.errors import DriverError, PortError, ServoError, ServoSilent
from hal.errors import ActivationError
from hal.joint import Joint
from hal.lifecycle import LifecycleState, require
from hal.types import JointCommand, JointState, ServoHealth

LOG = logging.getLogger("servoloop.hal")

OUTSIDE_TOLERANCE = 0.05
"""How far outside its limits (as a share of their span) a joint may stand when torque goes on."""
INTERPOLATION_MARGIN = 1.05
"""The servo is told to be a little faster than needed, so that what it lags behind is made up."""
INTERPOLATION_FLOOR_COUNTS_S = 20
READ_SHARE = 0.5
"""What share of the period reading may take, lost replies and second questions included."""
FIRST_PERIOD_S = 0.05
"""The period until a command tells it."""


class ServoHardware:
    """The life cycle of hal.lifecycle.Hardware over a ServoBus.

    ``interpolate`` tells each servo how fast to go, so that it moves through the whole period
    instead of leaping to the goal and waiting there.
    """

    def __init__(self, name: str, joints: Sequence[Joint], open_bus: Callable[[], ServoBus], clock: Clock) -> None:
        self.name = name
        self.joints = tuple(joint.name for joint in joints)
        self.state = LifecycleState.UNCONFIGURED
        self.interpolate = True
        self._joints = tuple(joints)
        self._ids = [joint.servo_id for joint in joints]
        self._by_id = {joint.servo_id: joint for joint in joints}
        self._open_bus = open_bus
        self._bus: ServoBus | None = None
        self._clock = clock
        self._period_s = FIRST_PERIOD_S
        self._goals: dict[int, int] = {}
        self._faults: dict[str, str] = {}
        self._last = self._unknown_state()

    def configure(self) -> None:
        require(self.state, LifecycleState.UNCONFIGURED, "configure")
        self._bus = self._open_bus()
        self.state = LifecycleState.INACTIVE
        self._faults.clear()
        self._last = self._unknown_state()
        try:
            self._check(self._bus)
            self.read()
        except BaseException:
            self.cleanup()
            raise

    def activate(self) -> None:
        """Torque on, joint by joint, each with its goal at the measured position.

        Where that fails, the servos that were limp before are limp again; one that a former program
        left under torque goes on holding: letting go would drop the arm.
        """
        require(self.state, LifecycleState.INACTIVE, "activate")
        bus = self._opened()
        self._faults.clear()
        measured = self._measure_all(bus)
        limp = [i for i in self._ids if not bus.torque_is_on(i)]
        self._goals = {i: self._start_goal(i, state) for i, state in measured.items()}
        try:
            for joint in self._joints:
                bus.limit_torque(joint.servo_id, joint.torque_limit)
            bus.write_goals({i: ServoGoal(counts) for i, counts in self._goals.items()})
            self._confirm_goals(bus)
            for servo_id in self._ids:
                bus.torque_on(servo_id)
        except BaseException:
            for problem in self._release(bus, limp):
                LOG.error("torque may still be on: %s", problem)
            raise
        self.state = LifecycleState.ACTIVE
        self.read()

    def deactivate(self, relax: bool) -> Sequence[str]:
        require(self.state, LifecycleState.ACTIVE, "deactivate")
        self.state = LifecycleState.INACTIVE
        return self._release(self._opened(), self._ids) if relax else []

    def cleanup(self) -> None:
        self.state = LifecycleState.UNCONFIGURED
        if self._bus is not None:
            self._bus.close()
            self._bus = None

    def read(self) -> JointState:
        """One exchange with all servos. A silent servo keeps its last values and is named."""
        deadline_s = self._clock.now() + READ_SHARE * self._period_s
        return self._take(self._opened().read_states(self._ids, deadline_s))

    def _take(self, readings: Mapping[int, Reading]) -> JointState:
        position, velocity = self._last.position.copy(), self._last.velocity.copy()
        effort = self._last.effort.copy()
        health = dict(self._last.health)
        counters = self._opened().counters
        for index, joint in enumerate(self._joints):
            reading = readings[joint.servo_id]
            self._note_fault(joint, reading)
            if isinstance(reading, ServoState):
                position[index] = joint.position(reading.position_counts)
                velocity[index] = reading.velocity_counts_s * joint.units_per_count
                effort[index] = reading.load * joint.full_effort * joint.sign
                account = counters.of(joint.servo_id)
                health[joint.name] = ServoHealth(reading.voltage_v, reading.temperature_c, reading.alarms, account)
        self._last = JointState(self._clock.now(), position, velocity, effort, dict(self._faults), health)
        return self._last

    def write(self, command: JointCommand) -> None:
        """One packet with a goal for every servo; the command has passed the safety gate."""
        require(self.state, LifecycleState.ACTIVE, "write")
        self._period_s = command.period_s
        goals: dict[int, ServoGoal] = {}
        for joint, position in zip(self._joints, command.position, strict=True):
            counts = self._within_reach(joint, joint.counts(float(position)), command.period_s)
            goals[joint.servo_id] = ServoGoal(counts, self._speed(joint, counts, command.period_s))
        self._opened().write_goals(goals)
        self._goals = {servo_id: goal.position_counts for servo_id, goal in goals.items()}

    def _within_reach(self, joint: Joint, counts: int, period_s: float) -> int:
        """A joint that began outside its limits has a goal there, and must not leap back in."""
        held = self._goals[joint.servo_id]
        reach = math.ceil(joint.limits.velocity * period_s / abs(joint.units_per_count))
        return min(max(counts, held - reach), held + reach)

    def _speed(self, joint: Joint, counts: int, period_s: float) -> int:
        if not self.interpolate:
            return 0
        way = abs(counts - self._goals[joint.servo_id])
        speed = way / period_s * INTERPOLATION_MARGIN + INTERPOLATION_FLOOR_COUNTS_S
        return min(round(speed), 32767)

    def _opened(self) -> ServoBus:
        if self._bus is None:
            require(self.state, LifecycleState.INACTIVE, "use the servos")
        assert self._bus is not None
        return self._bus

    def _check(self, bus: ServoBus) -> None:
        """Every servo is there and is what the robot file says; all that are not are named."""
        problems: dict[str, ServoError] = {}
        for joint in self._joints:
            try:
                bus.identify(joint.servo_id, joint.model)
            except ServoError as error:
                problems[joint.name] = error
        silent = [error for error in problems.values() if isinstance(error, ServoSilent)]
        if len(silent) == len(self._joints):
            raise DriverError(f"no servo answers on {bus.name}: check the servos' power and the baud rate")
        if problems:
            raise DriverError("\n".join(f"{name}: {error}" for name, error in problems.items()))

    def _measure_all(self, bus: ServoBus) -> dict[int, ServoState]:
        readings = bus.read_states(self._ids)
        silent = [f"{self._by_id[i].name}: {r.text}" for i, r in readings.items() if not isinstance(r, ServoState)]
        if silent:
            raise ActivationError("not activated: " + "; ".join(silent))
        self._take(readings)
        return {i: r for i, r in readings.items() if isinstance(r, ServoState)}

    def _start_goal(self, servo_id: int, state: ServoState) -> int:
        """The measured position, if it lies within the limits or (by play, a soft stop) almost."""
        joint = self._by_id[servo_id]
        position = joint.position(state.position_counts)
        lower, upper = joint.limits.lower, joint.limits.upper
        slack = OUTSIDE_TOLERANCE * (upper - lower)
        if not lower - slack <= position <= upper + slack:
            raise ActivationError(
                f"not activated: {joint.name} (servo {servo_id}) stands at {position:.4f}, outside "
                f"its limits {lower:.4f} to {upper:.4f}. Move it by hand, or correct zero_counts"
            )
        return state.position_counts

    def _confirm_goals(self, bus: ServoBus) -> None:
        """A sync write is no acknowledgement: ask each servo whether it has its goal."""
        for servo_id, counts in self._goals.items():
            held = bus.goal(servo_id)
            if held != counts:
                raise ActivationError(
                    f"not activated: {self._by_id[servo_id].name} (servo {servo_id}) holds goal "
                    f"{held}, not {counts}: check the cable"
                )

    def _release(self, bus: ServoBus, servo_ids: Sequence[int]) -> list[str]:
        """Torque off on every servo, whatever the others say."""
        try:
            return [str(error) for error in bus.torque_off(servo_ids)]
        except PortError as error:
            return [str(error)]

    def _note_fault(self, joint: Joint, reading: Reading) -> None:
        if not isinstance(reading, ServoState):
            if joint.name not in self._faults:
                LOG.error("%s: %s", joint.name, reading.text)
            self._faults[joint.name] = f"{joint.name}: {reading.text}"
        elif joint.name in self._faults and self.state is not LifecycleState.ACTIVE:
            del self._faults[joint.name]
        elif joint.name in self._faults:
            self._welcome_back(joint)

    def _welcome_back(self, joint: Joint) -> None:
        """A servo that lost its power comes back limp, and its goal is not ours any more."""
        try:
            driven = self._opened().torque_is_on(joint.servo_id)
        except ServoError:
            return
        if driven:
            LOG.warning("%s: servo %d answers again", joint.name, joint.servo_id)
            del self._faults[joint.name]
            return
        text = f"servo {joint.servo_id} came back without torque (power dip?): activate again"
        if text not in self._faults[joint.name]:
            LOG.error("%s: %s", joint.name, text)
        self._faults[joint.name] = f"{joint.name}: {text}"

    def _unknown_state(self) -> JointState:
        unknown = np.full(len(self._joints), np.nan)
        return JointState(self._clock.now(), unknown, unknown, unknown)
