"""Invariants on reported velocities, efforts, temperatures, voltages and alarms."""

import math
from collections import defaultdict, deque
from collections.abc import Callable, Iterable
from typing import Final

import numpy as np

from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from drivers.servos.catalog import registers_of, series_of
from drivers.servos.register import Register
from drivers.servos.voltage import voltage_range
from hal.joint import Joint
from hal.types import FloatArray, JointState, ServoHealth
from servoloop.campaign.invariants.invariant import Invariant
from servoloop.campaign.invariants.reference import read_reference
from servoloop.simulation.faulty_stack import FaultyStack

MOVES: Final = 0.15
"""Minimum speed at which a reported velocity is checked, as a fraction of the joint's velocity limit."""
STANDS: Final = 0.03
"""Maximum speed at which a reported effort is checked, as a fraction of the joint's velocity limit."""
PULLS: Final = 0.3
"""Minimum effort at which a reported effort is checked, in N m or N."""
PULLS_SHARE: Final = 0.05
"""Minimum effort at which a reported effort is checked, as a fraction of the full effort. Because of friction in the
gears, the servo does not detect a smaller effort.
"""
CYCLES: Final = 5
"""Number of cycles in which a joint must move or pull in one direction, because servos average their velocity."""
FACTOR: Final = 2.0
"""Factor by which a reported velocity may be outside the range of the true values in the latest cycles."""
EFFORT_FACTOR: Final = 8.0
"""Factor by which a reported effort may be outside the range of the true values. The servo estimates the effort from
its drive (measured factors: 0.2 to 1.8)."""
STEADY: Final = 1.5
"""Maximum ratio between the true values in the latest cycles at which the reported magnitude is checked."""
WRONG_CYCLES: Final = 2
"""Maximum number of consecutive cycles in which a value may be wrong because it changed within a cycle."""
QUANTITIES: Final = ("voltage", "supply", "load", "current", "temperature", "alarms")
"""Parts of a servo's health that are compared with its registers."""
VOLTAGES: Final = ("present_voltage", "present_input_voltage")
TEMPERATURES: Final = ("present_temperature",)
ALARMS: Final = {
    "status": {0: "voltage", 1: "angle sensor", 2: "temperature", 3: "current", 4: "angle", 5: "overload"},
    "hardware_error_status": {
        0: "voltage",
        2: "temperature",
        3: "motor encoder",
        4: "electrical shock",
        5: "overload",
    },
}
"""Names of the alarm bits in the error registers of STS servos (SDK) and of Dynamixel X servos (e-manual), written
independently of the drivers."""
VOLTS: Final = 0.1
"""Unit of the voltage registers, in V."""
OFF_V: Final = 1.0
"""Allowed difference between a reported voltage and the servo's register, in V."""
OFF_C: Final = 3.0
"""Allowed difference between a reported temperature and the servo's register, in degrees Celsius."""
CURRENT_UNITS_A: Final = {"xl330": 0.001, "xc330": 0.001, "xm430": 0.00269, "xm540": 0.00269}
"""Units of the current registers of Dynamixel X families in A (e-manual), written independently of the drivers."""
OFF_A: Final = 0.003
"""Allowed difference between a reported current and the servo's register, in A."""
COMPARED_CYCLES: Final = 4
"""Number of cycles between two comparisons of a servo's health."""
LATE_S: Final = 1.0
"""Maximum time until a change in a servo's health is reported, in seconds."""


class MotionIsTrue(Invariant):
    """Reported velocities and efforts have the same signs as in the simulated world, and about the same magnitudes."""

    name = "motion is true"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        names, world = stack.loop.hardware.joints, stack.world.joints
        self._names = [joint.name for joint in self.joints]
        self._reported = [names.index(name) for name in self._names]
        self._world = [world.index(name) for name in self._names]
        self._efforts = [stack.world.arrays.effort_at[place] for place in self._world]
        self._limits = np.array([joint.limits.velocity for joint in self.joints])
        self._pulls = np.array([max(PULLS, PULLS_SHARE * joint.full_effort) for joint in self.joints])
        self._rows = deque[tuple[FloatArray, FloatArray]](maxlen=CYCLES)
        """True velocities and efforts in the latest cycles."""
        self._before: FloatArray | None = None
        self._wrong = defaultdict[tuple[str, str], int](int)

    def on_state(self, state: JointState) -> None:
        here, before = self.stack.world.position()[self._world], self._before
        self._before = here
        if before is None or not self.active:
            self._rows.clear()
            return
        effort = self.stack.world.arrays.effort[self._efforts].copy()
        self._rows.append(((here - before) / self.stack.loop.period_s, effort))
        if len(self._rows) < CYCLES:
            return
        velocities, efforts = (np.array(rows) for rows in zip(*self._rows, strict=True))
        speeds = np.abs(velocities) / self._limits
        moves = speeds.min(axis=0) > MOVES
        pulls = (np.abs(efforts).min(axis=0) > self._pulls) & (speeds.max(axis=0) < STANDS)
        shared = self.sharing_id
        for place in np.flatnonzero(moves | pulls).tolist():
            name = self._names[place]
            if name in state.faults or name in shared or self.deceived(name) or self.servos[name].on_read:
                continue
            quantity, true = ("velocity", velocities) if moves[place] else ("effort", efforts)
            found = float(getattr(state, quantity)[self._reported[place]])
            lowest, highest = float(true[:, place].min()), float(true[:, place].max())
            if lowest * highest <= 0.0:
                continue
            self.examined += 1
            factor = FACTOR if moves[place] else EFFORT_FACTOR
            wrong = not found * lowest > 0.0 or not _near(abs(found), np.abs(true[:, place]), factor)
            cycles = self._wrong[quantity, name] = self._wrong[quantity, name] + 1 if wrong else 0
            if cycles > WRONG_CYCLES:
                was = f"but it was {lowest:.3f} to {highest:.3f}"
                self.say(f"the {quantity} of {name} is reported as {found:.3f}, {was}")


def _near(reported: float, true: FloatArray, factor: float) -> bool:
    """Return whether a magnitude is close to the true magnitudes, or whether these vary too much for a comparison."""
    lowest, highest = true.min(), true.max()
    return bool(highest > STEADY * lowest or lowest / factor <= reported <= highest * factor)


class HealthIsTrue(Invariant):
    """Reported voltages, currents, temperatures and alarms agree with the servo's registers, and wrong voltages are
    reported as faults. The current of a servo that measures its current is never unknown.

    These values change slowly, so they are compared in every fourth cycle only.
    """

    name = "health is true"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._off_s: dict[tuple[str, str], float] = {}
        """Time for which each quantity has been wrong, in seconds, keyed by joint name and quantity."""
        self._cycles = 0
        self._efforts = {name: place for place, name in enumerate(stack.loop.hardware.joints)}
        self._voltage = {joint.name: _register(joint, VOLTAGES) for joint in self.joints}
        self._current = {joint.name: _current_of(joint) for joint in self.joints}
        reference = read_reference(stack.files)
        self._sign = {name: math.copysign(1.0, joint.units_per_count) for name, joint in reference.items()}
        self._temperature = {joint.name: _register(joint, TEMPERATURES) for joint in self.joints}

    def on_state(self, state: JointState) -> None:
        self._cycles += 1
        known = self._known(state)
        self._off_s = {key: off_s for key, off_s in self._off_s.items() if key[0] in known}
        for joint in self.joints if self._cycles % COMPARED_CYCLES == 0 else ():
            if joint.name in known:
                self.examined += 1
                effort = state.effort[self._efforts[joint.name]]
                self._compare(joint.name, self._differences(joint, known[joint.name], effort))

    def _known(self, state: JointState) -> dict[str, ServoHealth]:
        """Return the health of each joint without a fault whose servo alone has replied."""
        if not self.active:
            return {}
        excused = state.faults.keys() | self.sharing_id
        health = {name: one for name, one in state.health.items() if name not in excused}
        return {name: one for name, one in health.items() if not self.servos[name].on_read}

    def _compare(self, joint: str, found: dict[str, str]) -> None:
        """Report the quantities that have been wrong for too long. ``found`` contains those that are wrong now."""
        for quantity in QUANTITIES:
            off_s = self._off_s.pop((joint, quantity), 0.0) + COMPARED_CYCLES * self.stack.loop.period_s
            if quantity in found:
                self._off_s[joint, quantity] = off_s
                if off_s > LATE_S:
                    self.say(f"the {quantity} of {joint} is reported as {found[quantity]}")

    def _differences(self, joint: Joint, health: ServoHealth, effort: float) -> dict[str, str]:
        """Return the reported and the true value of each quantity for which they differ.

        The load must have the same sign as the reported ``effort``, which "motion is true" examines.
        """
        memory, found = self.servos[joint.name].memory, {}
        if health.load * effort < 0.0:
            found["load"] = f"{health.load:+.3f}, but the effort is {effort:+.3f}"
        voltage, temperature = self._voltage[joint.name], self._temperature[joint.name]
        if voltage is not None and abs((true := VOLTS * memory.get(voltage)) - health.voltage_v) > OFF_V:
            found["voltage"] = f"{health.voltage_v:.1f} V, but the register is {true:.1f} V"
        if voltage is not None and (health.supply is None or not health.supply.outside):
            lowest, highest = voltage_range(joint.model)
            true = VOLTS * memory.get(voltage)
            if true > 0.0 and not lowest - VOLTS <= true <= highest + VOLTS:  # 0 V: the servo does not measure it
                found["supply"] = f"usual, but the register is {true:.1f} V"
        if temperature is not None and abs((celsius := memory.get(temperature)) - health.temperature_c) > OFF_C:
            found["temperature"] = f"{health.temperature_c:g} degrees, but the register is {celsius:g} degrees"
        if (current := self._current[joint.name]) is not None and joint.name in self._sign:
            register, unit_a = current
            ampere = memory.get(register) * unit_a * self._sign[joint.name]
            if not abs(ampere - health.current_a) <= OFF_A:
                found["current"] = f"{health.current_a:.3f} A, but the register is {ampere:.3f} A"
        alarms = alarm_names(self.error_bits(joint))
        if alarms != set(health.alarms):
            reported, true = (", ".join(sorted(names)) or "none" for names in (health.alarms, alarms))
            found["alarms"] = f"{reported}, but the servo's alarms are: {true}"
        return found


def alarm_names(registers: Iterable[tuple[str, int]]) -> set[str]:
    """Return the names of the alarms in error registers, given as pairs of a register name and a value."""
    return {name for register, bits in registers for bit, name in ALARMS[register].items() if bits >> bit & 1}


def _current_of(joint: Joint) -> tuple[Register, float] | None:
    """Return the register with the current of the joint's servo and the unit of this register, in A."""
    registers = {one.name: one for one in registers_of(joint.model)}
    unit_a = next((unit for family, unit in CURRENT_UNITS_A.items() if joint.model.name.startswith(family)), None)
    register = registers.get("present_current")
    return None if register is None or unit_a is None else (register, unit_a)


def _register(joint: Joint, names: tuple[str, ...]) -> Register | None:
    """Return the first register of the joint's servo that has one of these names."""
    registers = series_of(joint.model).registers
    return next((register for register in registers if register.name in names), None)
