"""The joints' states by their servos' readings, and how a servo that was missing rejoins."""

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from drivers.bus.types import Reading, ServoFault, ServoState
from drivers.clock import Clock
from hal.joint import Joint
from hal.joint_buses import JointBuses
from hal.types import JointFault, JointState, ServoHealth

LOG = logging.getLogger("servoloop.hal")

WITHHELD_AFTER: Final = 2
"""A servo that was missing for so many cycles gets no goals before it has been asked whether it drives its motor."""


class ServoStates:
    """The states of one component's joints: a silent servo keeps its last values, and is named until it has rejoined.

    An active component's servo has to show first that it still drives its motor.
    """

    def __init__(self, joints: Sequence[Joint], clock: Clock) -> None:
        self.measured: dict[str, int] = {}
        """Counts by joint name, where the servo answered in the last exchange."""
        self.missing: dict[str, int] = {}
        """For how many cycles a joint's servo has not answered, until it has shown that it drives its motor."""
        self._joints = tuple(joints)
        self._zero = np.array([joint.zero_counts for joint in joints])
        self._units_per_count = np.array([joint.units_per_count for joint in joints])
        self._signed_effort = np.array([joint.full_effort * joint.sign for joint in joints])
        self._clock = clock
        self._faults: dict[str, JointFault] = {}
        self._last = self._unknown()

    def reset(self) -> None:
        """Forget all that is known of the joints."""
        self.forget_faults()
        self._last = self._unknown()

    def forget_faults(self) -> None:
        """Forget all faults: the servos start anew."""
        self._faults.clear()
        self.missing.clear()

    def update(
        self, readings: Mapping[str, Reading], buses: JointBuses, ask_until_s: float | None = None
    ) -> JointState:
        """The joints' state after these readings (by joint name).

        ``ask_until_s``: servos that are to drive their motors, and answer again, are asked for that until then.
        """
        raw = np.full((3, len(self._joints)), np.nan)  # counts, counts/s, share of full drive
        health = dict(self._last.health)
        counters = buses.counters()
        self.measured.clear()
        for index, joint in enumerate(self._joints):
            reading = readings[joint.name]
            account = counters[joint.bus].servos[joint.servo_id]
            if isinstance(reading, ServoState):
                self.measured[joint.name] = reading.position_counts
                raw[:, index] = reading.position_counts, reading.velocity_counts_s, reading.load
                load = reading.load * joint.sign
                current_a = math.nan if reading.current_a is None else reading.current_a * joint.sign
                health[joint.name] = ServoHealth(
                    reading.voltage_v, reading.temperature_c, reading.alarms, account, load, current_a
                )
                continue
            self._note(joint.name, reading)
            if joint.name in health:  # what is counted of a silent servo goes on
                health[joint.name] = replace(health[joint.name], counters=account)
        faults = self._present_faults(buses, ask_until_s) if self._faults else {}
        lines = {buses.port(name): account for name, account in counters.items()}
        last = self._last
        answered = ~np.isnan(raw[0])
        position = np.where(answered, (raw[0] - self._zero) * self._units_per_count, last.position)
        velocity = np.where(answered, raw[1] * self._units_per_count, last.velocity)
        effort = np.where(answered, raw[2] * self._signed_effort, last.effort)
        self._last = JointState(self._clock.now(), position, velocity, effort, faults, health, lines=lines)
        return self._last

    def _note(self, name: str, fault: ServoFault) -> None:
        found = JointFault(fault.kind, fault.text)
        if name not in self._faults and found not in self._faults.values():  # a line's is told once
            LOG.error("%s", found.text)
        self._faults[name] = found
        self.missing[name] = self.missing.get(name, 0) + 1

    def _present_faults(self, buses: JointBuses, ask_until_s: float | None) -> dict[str, JointFault]:
        """A servo that answers again is no fault, whether it has been asked for its torque already or not."""
        back = [joint for joint in self._joints if joint.name in self._faults and joint.name in self.measured]
        if ask_until_s is not None and back:
            self._rejoin(back, buses, ask_until_s)
        elif ask_until_s is None:
            for joint in back:
                self._forget(joint.name)
        return {
            name: fault
            for name, fault in self._faults.items()
            if name not in self.measured or fault.kind == "no_torque"
        }

    def _rejoin(self, back: Sequence[Joint], buses: JointBuses, ask_until_s: float) -> None:
        """Take back all that were missing and answer again; whoever there is no time to ask waits for the next cycle.

        A servo that lost its power comes back limp, and its goal is not ours any more.
        """
        called = {joint.name: f"{buses.label(joint)}: servo {joint.servo_id}" for joint in back}
        for name, driven in buses.torque_states(back, ask_until_s).items():
            if driven:
                LOG.warning("%s answers again", called[name])
                self._forget(name)
            else:
                self._refuse_limp(name, called[name])

    def _forget(self, name: str) -> None:
        self._faults.pop(name, None)
        self.missing.pop(name, None)

    def _refuse_limp(self, name: str, called: str) -> None:
        fault = JointFault("no_torque", f"{called} came back without torque (power dip?): activate again")
        if self._faults[name].kind != "no_torque":
            LOG.error("%s", fault.text)
        self._faults[name] = fault
        self.missing[name] = WITHHELD_AFTER

    def _unknown(self) -> JointState:
        unknown = np.full(len(self._joints), np.nan)
        return JointState(self._clock.now(), unknown, unknown, unknown)
