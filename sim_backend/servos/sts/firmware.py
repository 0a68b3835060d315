"""The firmware of one virtual STS servo: the compiled millisecond, and what the wire may do to it."""

from dataclasses import dataclass
from typing import Final

from drivers.servos import sts
from drivers.servos.register import Register
from sim_backend.mechanics.motor import MotorConstants
from sim_backend.servos.sts import kernel
from sim_backend.servos.sts.memory import StsMemory
from sim_backend.servos.sts.state import STATE, States, forget_volatile, new_states

ENCODER_LAG_S: Final = 0.0018
"""Of the AS5600's own filter, as fitted to step responses recorded on hardware; its data sheet says about 2 ms."""
_NOTED: Final = (
    (sts.goal_position, kernel.GOAL_NOTED),
    (sts.goal_time, kernel.PWM_NOTED),
    (sts.goal_velocity, kernel.SPEED_NOTED),
    (sts.torque_enable, kernel.SWITCH_NOTED),
    (sts.acceleration, kernel.RAMP_NOTED),
)

_NO_OFFSET: Final = 1 << 16
"""No register holds it: the next millisecond takes the homing offset anew, even one that has not changed."""
_WINDING: Final = ("torque_constant_nm_a", "back_emf_v_s", "resistance_ohm")
"""What is in proportion to the turns of the motor's wire."""


@dataclass(frozen=True, slots=True)
class StsVariant:
    """How a firmware behaves where reports contradict each other or come from one source alone."""

    goal_write_energises: bool = True
    """A write of the mode's goal switches torque on."""
    torque_on_takes_goal: bool = False
    """Torque that is switched on goes for what the goal register holds, instead of holding the shaft where it is."""
    forgets_goal_within_tick: bool = True
    """A goal, 41 or 46 is lost if another write follows within the same millisecond and leaves that one alone."""


AS_REIMPLEMENTED: Final = StsVariant()
"""What the reimplemented firmware does."""


def sts_states(motor: MotorConstants, variant: StsVariant) -> States:
    """The record of one servo, cold and without power."""
    return new_states(
        torque_constant_nm_a=motor.torque_constant_nm_a,
        back_emf_v_s=motor.back_emf_v_s,
        resistance_ohm=motor.resistance_ohm,
        thermal_resistance_k_w=motor.thermal_resistance_k_w,
        thermal_time_s=motor.thermal_time_s,
        ambient_c=motor.ambient_c,
        temperature_c=motor.ambient_c,
        encoder_lag_s=ENCODER_LAG_S,
        goal_write_energises=variant.goal_write_energises,
        torque_on_takes_goal=variant.torque_on_takes_goal,
    )


class StsFirmware:
    """The firmware of one servo. ``step`` is called at a fixed rate and must stay cheap."""

    def __init__(self, memory: StsMemory, states: States, voltage_v: float, variant: StsVariant) -> None:
        self._memory = memory
        self._take(states)
        self._variant = variant
        self._wound = {name: self._value(name) for name in _WINDING}
        self.voltage_v = voltage_v
        self.restart()
        self.step(0.0, 0.0, 0.0)  # what has to be compiled is compiled now, not within a paced line's first millisecond

    def work_on(self, states: States) -> None:
        """Move into this record: a line keeps those of all its servos side by side."""
        states[:] = self._states
        self._take(states)
        self._memory.work_on(states)

    def _take(self, states: States) -> None:
        self._states = states
        # Each is looked up once: the line asks for some of them with every packet.
        self._fields = {name: states[name] for name in STATE.names or ()}

    def restart(self) -> None:
        """Power-on: all state from the registers, the motor free."""
        forget_volatile(self._states)
        kernel.power_on(self._states, self.voltage_v)

    def observe(self, angle_rad: float) -> None:
        """Take the shaft's angle as it is, at rest: the first look after power-on, or a shaft put there by hand."""
        self._fields["lagged_rad"][0] = angle_rad
        kernel.look(self._states, self.voltage_v)

    def step(self, dt_s: float, angle_rad: float, velocity_rad_s: float) -> float:
        """``dt_s`` of the loop on the shaft's true state; returns the torque on the shaft, N m."""
        torque_nm, current_a = kernel.step(self._states, dt_s, angle_rad, velocity_rad_s, self.voltage_v)
        self._fields["supply_current_a"][0] = current_a
        return torque_nm

    def note_write(self, address: int, size: int) -> None:
        """A write happened: the next millisecond looks at which goals and settings of the profile it touched."""
        noted = sum(bit for register, bit in _NOTED if touches(address, size, register))
        if not self._variant.forgets_goal_within_tick:
            noted |= self._number("noted")
        self._fields["noted"][0] = noted
        if touches(address, size, sts.homing_offset):
            self._fields["offset"][0] = _NO_OFFSET

    def forget_turns(self) -> None:
        """The present angle is within the first turn again."""
        self._fields["recount"][0] = 1

    @property
    def voltage_v(self) -> float:
        """What the supply has left for it."""
        return self._value("voltage_v")

    @voltage_v.setter
    def voltage_v(self, voltage_v: float) -> None:
        self._fields["voltage_v"][0] = voltage_v

    @property
    def supply_current_a(self) -> float:
        """What the motor takes from the supply."""
        return self._value("supply_current_a")

    @property
    def deaf_s(self) -> float:
        """For how long it will not hear anything, because it reboots."""
        return self._value("deaf_s")

    @deaf_s.setter
    def deaf_s(self, seconds: float) -> None:
        self._fields["deaf_s"][0] = seconds

    @property
    def encoder_fails(self) -> bool:
        """Whether the encoder has stopped answering the firmware; a fault to inject, which power-off does not mend."""
        return bool(self._number("encoder_fails"))

    @encoder_fails.setter
    def encoder_fails(self, fails: bool) -> None:
        self._fields["encoder_fails"][0] = fails

    @property
    def encoder_sticks(self) -> bool:
        """Whether the encoder goes on saying what it said last; a fault to inject, as the one above."""
        return bool(self._number("encoder_sticks"))

    @encoder_sticks.setter
    def encoder_sticks(self, sticks: bool) -> None:
        self._fields["encoder_sticks"][0] = sticks

    @property
    def turns_left(self) -> float:
        """The share of its motor's turns of wire that are not shorted; a fault to inject."""
        return self._value("resistance_ohm") / self._wound["resistance_ohm"]

    @turns_left.setter
    def turns_left(self, share: float) -> None:
        for name, whole in self._wound.items():
            self._fields[name][0] = whole * share

    @property
    def raw_count(self) -> int:
        """The encoder's count within the turn, before the homing offset."""
        return self._number("raw")

    @property
    def position(self) -> int:
        """Where the servo sees its shaft, counts, turns included."""
        return self._number("position")

    @property
    def setpoint(self) -> float:
        """Where its profile wants the shaft now, counts, turns included."""
        return self._number("setpoint_e4") / kernel.FINE

    @property
    def status(self) -> int:
        """What every reply says of the protections."""
        return self._number("status")

    @property
    def current_a(self) -> float:
        """Through the motor, with its direction."""
        return self._value("current_a")

    @property
    def temperature_c(self) -> float:
        """Of the motor."""
        return self._value("temperature_c")

    @temperature_c.setter
    def temperature_c(self, temperature_c: float) -> None:
        self._fields["temperature_c"][0] = temperature_c

    def _number(self, name: str) -> int:
        return int(self._fields[name].item())

    def _value(self, name: str) -> float:
        return float(self._fields[name].item())


def touches(address: int, size: int, register: Register) -> bool:
    """Whether a write of ``size`` bytes from ``address`` on has a byte of ``register``."""
    return address < register.address + register.size and register.address < address + size
