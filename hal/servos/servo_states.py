"""Convert servo readings to joint states."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from drivers.bus.types import Reading, ServoState
from drivers.clock import Clock
from hal.joint import Joint
from hal.leaps import Plausibility
from hal.servos.joint_buses import JointBuses
from hal.servos.servo_faults import ServoFaults
from hal.servos.supply_watch import SupplyWatch
from hal.types import JointFault, JointState, ServoHealth, Stall


class ServoStates:
    """Joint states of one hardware component. A joint whose servo is silent keeps its last state."""

    def __init__(self, joints: Sequence[Joint], clock: Clock) -> None:
        self.measured: dict[str, int] = {}
        """Counts of the servos that answered in the last exchange, by joint name."""
        self.loads: dict[str, float] = {}
        """Drive of these servos as a share of full drive, by joint name."""
        self.stalls: Mapping[str, Stall] = {}
        """Servos that press without motion, by joint name."""
        self.faults = ServoFaults(joints, clock)
        self._supply = SupplyWatch(joints, clock, self.faults.log)
        self._joints = tuple(joints)
        self._zero = np.array([joint.zero_counts for joint in joints])
        self._units_per_count = np.array([joint.units_per_count for joint in joints])
        self._signed_effort = np.array([joint.full_effort * joint.sign for joint in joints])
        self._clock = clock
        self._last = self._unknown()
        self._plausibility = self._unread()

    def reset(self) -> None:
        """Discard all joint states and faults."""
        self.faults.forget()
        self._supply.forget()
        self._last = self._unknown()
        self._plausibility = self._unread()

    def update(
        self, readings: Mapping[str, Reading], buses: JointBuses, ask_until_s: float | None = None
    ) -> JointState:
        """Return the joint states after one exchange on the bus.

        Args:
            readings: Reading of each joint, by joint name.
            buses: Buses of the joints, with their counters.
            ask_until_s: Clock time until which servos may be asked whether their torque is enabled. None if the
                component is not active.
        """
        now_s = self._clock.now()
        raw = np.full((3, len(self._joints)), np.nan)  # counts, counts/s, share of full drive
        health = dict(self._last.health)
        counters = buses.counters()
        self.measured.clear()
        for index, joint in enumerate(self._joints):
            account = counters[joint.bus].servos[joint.servo_id]
            reading: Reading | JointFault = readings[joint.name]
            if isinstance(reading, ServoState):
                reading = self._believed(index, reading, buses, now_s, driven=ask_until_s is not None)
            if isinstance(reading, ServoState):
                self.measured[joint.name] = reading.position_counts
                self.loads[joint.name] = reading.load
                if reading.alarms and ask_until_s is not None:
                    self.faults.note_alarms(joint, reading.alarms, buses)
                raw[:, index] = reading.position_counts, reading.velocity_counts_s, reading.load
                load = reading.load * joint.sign
                current_a = math.nan if reading.current_a is None else reading.current_a * joint.sign
                health[joint.name] = ServoHealth(
                    *(reading.voltage_v, reading.temperature_c, reading.alarms, account, load, current_a),
                    supply=self._supply.check(joint, reading.voltage_v, buses.label(joint)),
                    stall=self.stalls.get(joint.name),
                )
                continue
            account.implausible += reading.kind == "implausible"
            self.faults.note_missing(joint, reading, self._last.stamp_s, buses)
            if joint.name in health:  # the counters of a silent servo must be up to date
                health[joint.name] = replace(health[joint.name], counters=account)
        try:
            faults = self.faults.present(self.measured, buses, ask_until_s)
        finally:
            if self.faults.log.events:
                self.faults.log.flush()
        lines = {buses.port(name): account for name, account in counters.items()}
        last = self._last
        answered = ~np.isnan(raw[0])
        position = np.where(answered, (raw[0] - self._zero) * self._units_per_count, last.position)
        velocity = np.where(answered, raw[1] * self._units_per_count, last.velocity)
        effort = np.where(answered, raw[2] * self._signed_effort, last.effort)
        self._last = JointState(self._clock.now(), position, velocity, effort, faults, health, lines=lines)
        return self._last

    def _believed(
        self, index: int, reading: ServoState, buses: JointBuses, now_s: float, driven: bool
    ) -> ServoState | JointFault:
        """Return the reading, or a fault if the joint cannot have reached the position."""
        joint = self._joints[index]
        position = (reading.position_counts - joint.zero_counts) * float(self._units_per_count[index])
        leap = self._plausibility[index].leap(position, now_s, driven)
        if leap is None:
            return reading
        return JointFault(
            "implausible",
            f"{buses.label(joint)}: servo {joint.servo_id} reports {reading.position_counts} counts, {leap:+.4f} from "
            "the previous reading. No joint moves that fast, so the position is ignored until a second reading "
            "confirms it",
        )

    def _unread(self) -> list[Plausibility]:
        return [Plausibility.of_servo(joint) for joint in self._joints]

    def _unknown(self) -> JointState:
        unknown = np.full(len(self._joints), np.nan)
        return JointState(self._clock.now(), unknown, unknown, unknown)
