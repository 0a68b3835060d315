"""Convert servo readings to joint states."""

import math
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from drivers.bus.counters import ServoCounters
from drivers.clock import Clock
from drivers.types import Reading, ServoState
from hal.joint import Joint
from hal.leaps import Plausibility, SeamCrossings
from hal.servos.joint_buses import JointBuses
from hal.servos.servo_faults import ServoFaults
from hal.servos.supply_watch import SupplyWatch
from hal.types import JointFault, JointState, ServoHealth, Stall


class ServoStates:
    """Joint states of one hardware component. A joint whose servo is silent keeps its last known state."""

    def __init__(self, joints: Sequence[Joint], clock: Clock) -> None:
        self.measured: dict[str, int] = {}
        """Counts of the servos that replied in the last exchange, keyed by joint name."""
        self.loads: dict[str, float] = {}
        """Drive of the servos that replied in the last exchange, as a fraction of full drive, keyed by joint name."""
        self.stalls: Mapping[str, Stall] = {}
        """Servos that push without moving, keyed by joint name."""
        self.faults = ServoFaults(joints, clock)
        self._supply = SupplyWatch(joints, clock, self.faults.log)
        self._joints = tuple(joints)
        self._signed_effort = [joint.full_effort * joint.sign for joint in joints]
        self._clock = clock
        self._last = self._unknown()
        self._plausibility = self._unread()
        self._seams = SeamCrossings(joints)

    def reset(self) -> None:
        """Discard all joint states and faults."""
        self.faults.forget()
        self._seams.forget()
        self._supply.forget()
        self._last = self._unknown()
        self._plausibility = self._unread()

    def reactivated(self, names: Collection[str]) -> None:
        """Note that torque was enabled for limp joints at their measured positions."""
        self.faults.reactivated(names)
        self._seams.forget(names)

    def update(
        self, readings: Mapping[str, Reading], buses: JointBuses, ask_until_s: float | None = None
    ) -> JointState:
        """Return the joint states after one exchange on each bus.

        Args:
            readings: Servo readings, keyed by joint name.
            buses: Buses of the joints, with their counters.
            ask_until_s: Clock time until which torque may be checked. None if the component is not active.
        """
        now_s, last = self._clock.now(), self._last
        # Floats are faster here than arrays of a few joints. Joints without a reading keep their last known values.
        position, velocity, effort = last.position.tolist(), last.velocity.tolist(), last.effort.tolist()
        health, counters = dict(last.health), buses.counters()
        self.measured.clear()
        if ask_until_s is None:
            self._seams.forget()
        for index, joint in enumerate(self._joints):
            account = counters[joint.bus].servos[joint.servo_id]
            reading: Reading | JointFault = readings[joint.name]
            if isinstance(reading, ServoState):
                counts = self._seams.counts(joint.name, reading.position_counts)
                at = joint.position(counts)
                leap = self._plausibility[index].leap(at, now_s, ask_until_s is not None)
                if leap is None:
                    self._seams.believed(joint.name, counts)
                    reading = reading._replace(position_counts=counts)
                    position[index], velocity[index] = at, reading.velocity_counts_s * joint.units_per_count
                    effort[index] = reading.load * self._signed_effort[index]
                    health[joint.name] = self._measure(joint, reading, account, buses)
                    if reading.alarms and ask_until_s is not None:
                        self.faults.note_alarms(joint, reading.alarms, buses)
                    continue
                reading = _implausible(joint, reading, leap, buses)
            account.implausible += reading.kind == "implausible"
            self.faults.note_missing(joint, reading, last.stamp_s, buses)
            if joint.name in health:  # the counters of a silent servo must also be up to date
                health[joint.name] = health[joint.name]._replace(counters=account)
        try:
            faults = self.faults.present(self.measured, buses, ask_until_s)
        finally:
            if self.faults.log.events:
                self.faults.log.flush()
        if faults:
            self._seams.forget(self.faults.limp)  # a limp joint can be turned by hand by whole turns
        lines = {buses.port(name): account for name, account in counters.items()}
        arrays = np.array(position), np.array(velocity), np.array(effort)
        self._last = JointState(self._clock.now(), *arrays, faults, health, lines=lines)
        return self._last

    def _measure(self, joint: Joint, reading: ServoState, account: ServoCounters, buses: JointBuses) -> ServoHealth:
        """Record the counts and the drive of a servo that replied, and return its health."""
        name, load, current_a = joint.name, reading.load, reading.current_a
        self.measured[name], self.loads[name] = reading.position_counts, load
        return ServoHealth(
            reading.voltage_v,
            reading.temperature_c,
            reading.alarms,
            account,
            load * joint.sign,
            math.nan if current_a is None else current_a * joint.sign,
            self._supply.check(joint, reading.voltage_v, buses.label(joint)),
            self.stalls.get(name),
        )

    def _unread(self) -> list[Plausibility]:
        return [Plausibility.of_servo(joint) for joint in self._joints]

    def _unknown(self) -> JointState:
        unknown = np.full(len(self._joints), np.nan)
        return JointState(self._clock.now(), unknown, unknown, unknown)


def _implausible(joint: Joint, reading: ServoState, leap: float, buses: JointBuses) -> JointFault:
    """Return a fault if the joint cannot have reached its measured position."""
    return JointFault(
        "implausible",
        f"{buses.label(joint)}: servo {joint.servo_id} reports {reading.position_counts} counts, {leap:+.4f} from "
        "the previous reading. No joint moves that fast, so the position is ignored until a second reading "
        "confirms it",
    )
