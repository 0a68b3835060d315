"""Firmware of one virtual STS servo: the Python interface of the compiled kernel."""

from dataclasses import dataclass
from typing import Final

from drivers.servos import sts
from sim_backend.mechanics.motor import MotorConstants
from sim_backend.servos.generic.memory import touches
from sim_backend.servos.sts import kernel
from sim_backend.servos.sts.memory import StsMemory
from sim_backend.servos.sts.state import STATE, States, forget_volatile, new_states

ENCODER_LAG_S: Final = 0.0018
"""Time constant of the AS5600's filter, fitted to step responses of real servos. The data sheet of the AS5600 specifies
about 2 ms."""
_NOTED: Final = (
    (sts.goal_position, kernel.GOAL_NOTED),
    (sts.goal_time, kernel.PWM_NOTED),
    (sts.goal_velocity, kernel.SPEED_NOTED),
    (sts.torque_enable, kernel.SWITCH_NOTED),
    (sts.acceleration, kernel.RAMP_NOTED),
)

_NO_OFFSET: Final = 1 << 16
"""A value that does not fit in a register. This value makes the kernel load the homing offset again, even if the offset
has not changed."""
_WINDING: Final = ("torque_constant_nm_a", "back_emf_v_s", "resistance_ohm")
"""Motor constants that are proportional to the number of turns in the winding."""


@dataclass(frozen=True, slots=True)
class StsVariant:
    """Firmware behavior for which reports contradict each other, or which only one source describes."""

    goal_write_energises: bool = True
    """Whether writing the operating mode's goal enables torque."""
    torque_on_takes_goal: bool = False
    """Whether the servo moves to the position in the goal register when torque is enabled. If false, the servo holds
    its current position."""
    forgets_goal_within_tick: bool = True
    """Whether a written goal, acceleration or velocity is lost if another write follows within the same millisecond."""


AS_REIMPLEMENTED: Final = StsVariant()
"""Behavior of the open-source reimplementation of the firmware."""


def sts_states(motor: MotorConstants, variant: StsVariant) -> States:
    """Return the record of one servo that has no power and is at ambient temperature."""
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
    """Firmware of one servo. ``step`` is called at a fixed rate and must be fast."""

    def __init__(self, memory: StsMemory, states: States, voltage_v: float, variant: StsVariant) -> None:
        self._memory = memory
        self._take(states)
        self._variant = variant
        self._wound = {name: self._value(name) for name in _WINDING}
        self.voltage_v = voltage_v
        self.restart()
        self.step(0.0, 0.0, 0.0)  # Compile or load the kernel now, not during the first millisecond of a real-time bus.

    def work_on(self, states: States) -> None:
        """Move the servo's state into this array. A bus keeps the records of all its servos in a single array."""
        states[:] = self._states
        self._take(states)
        self._memory.work_on(states)

    def _take(self, states: States) -> None:
        self._states = states
        # The fields are looked up once, because the bus reads some of them for every packet.
        self._fields = {name: states[name] for name in STATE.names or ()}

    def restart(self) -> None:
        """Restart as after power-on: load the state from the registers, with the torque disabled."""
        forget_volatile(self._states)
        kernel.power_on(self._states, self.voltage_v)

    def observe(self, angle_rad: float) -> None:
        """Set the shaft angle without simulating a motion, at power-on or after the shaft was turned by hand."""
        self._fields["lagged_rad"][0] = angle_rad
        kernel.look(self._states, self.voltage_v)

    def step(self, dt_s: float, angle_rad: float, velocity_rad_s: float) -> float:
        """Advance the firmware by ``dt_s`` with the true state of the shaft. Return the torque on the shaft (N m)."""
        torque_nm, current_a = kernel.step(self._states, dt_s, angle_rad, velocity_rad_s, self.voltage_v)
        self._fields["supply_current_a"][0] = current_a
        return torque_nm

    def note_write(self, address: int, size: int) -> None:
        """Record which goals and profile settings a write has changed, for use in the next millisecond."""
        noted = sum(bit for register, bit in _NOTED if touches(address, size, register))
        if not self._variant.forgets_goal_within_tick:
            noted |= self._number("noted")
        self._fields["noted"][0] = noted
        if touches(address, size, sts.homing_offset):
            self._fields["offset"][0] = _NO_OFFSET

    def forget_turns(self) -> None:
        """Reset the count of turns, so that the present angle is within the first turn."""
        self._fields["recount"][0] = 1

    @property
    def voltage_v(self) -> float:
        """Voltage at the servo, in volts."""
        return self._value("voltage_v")

    @voltage_v.setter
    def voltage_v(self, voltage_v: float) -> None:
        self._fields["voltage_v"][0] = voltage_v

    @property
    def supply_current_a(self) -> float:
        """Current that the motor draws from the supply, in amperes."""
        return self._value("supply_current_a")

    @property
    def deaf_s(self) -> float:
        """Remaining time of a reboot, in seconds; during this time, the servo ignores all instructions."""
        return self._value("deaf_s")

    @deaf_s.setter
    def deaf_s(self, seconds: float) -> None:
        self._fields["deaf_s"][0] = seconds

    @property
    def encoder_fails(self) -> bool:
        """Whether the encoder does not respond to the firmware. This injected fault remains after a power-off."""
        return bool(self._number("encoder_fails"))

    @encoder_fails.setter
    def encoder_fails(self, fails: bool) -> None:
        self._fields["encoder_fails"][0] = fails

    @property
    def encoder_sticks(self) -> bool:
        """Whether the encoder repeats its last value. This injected fault remains after a power-off."""
        return bool(self._number("encoder_sticks"))

    @encoder_sticks.setter
    def encoder_sticks(self, sticks: bool) -> None:
        self._fields["encoder_sticks"][0] = sticks

    @property
    def turns_left(self) -> float:
        """Fraction of the motor's winding that is not shorted (an injected fault)."""
        return self._value("resistance_ohm") / self._wound["resistance_ohm"]

    @turns_left.setter
    def turns_left(self, share: float) -> None:
        for name, whole in self._wound.items():
            self._fields[name][0] = whole * share

    @property
    def raw_count(self) -> int:
        """Encoder count within one turn, excluding the homing offset."""
        return self._number("raw")

    @property
    def position(self) -> int:
        """Position that the servo measures, in counts including turns."""
        return self._number("position")

    @property
    def setpoint(self) -> float:
        """Current set-point of the motion profile, in counts including turns."""
        return self._number("setpoint_e4") / kernel.FINE

    @property
    def status(self) -> int:
        """Status bits of the protections, as sent in every reply."""
        return self._number("status")

    @property
    def current_a(self) -> float:
        """Signed motor current, in amperes."""
        return self._value("current_a")

    @property
    def temperature_c(self) -> float:
        """Temperature of the motor, in degrees Celsius."""
        return self._value("temperature_c")

    @temperature_c.setter
    def temperature_c(self, temperature_c: float) -> None:
        self._fields["temperature_c"][0] = temperature_c

    def _number(self, name: str) -> int:
        return int(self._fields[name].item())

    def _value(self, name: str) -> float:
        return float(self._fields[name].item())
