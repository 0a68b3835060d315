"""The compiled firmware of an STS servo compared with a slow and simple implementation (``plain_sts``)."""

from dataclasses import dataclass
from math import pi
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from drivers.servos import sts
from drivers.servos.register import Register
from sim_backend.mechanics.motor import STS3215_12V
from sim_backend.servos.sts import kernel
from sim_backend.servos.sts.firmware import StsVariant, sts_states
from sim_backend.servos.sts.memory import StsMemory
from sim_backend.servos.sts.servo import VirtualServo
from tests.sim_backend.plain_sts import PlainServo, Settings

DT_S = 0.001
INERTIA, FRICTION = 0.0154, 0.05

REGISTERS: dict[str, Register] = {
    "min_position": sts.min_position, "max_position": sts.max_position, "phase": sts.phase,
    "unloading": sts.unloading_condition, "p": sts.position_p, "d": sts.position_d, "i": sts.position_i,
    "punch": sts.minimum_startup_force, "i_limit": sts.integral_limit, "dead_above": sts.cw_dead_zone,
    "dead_below": sts.ccw_dead_zone, "current_limit": sts.protection_current, "resolution": sts.angular_resolution,
    "offset": sts.homing_offset, "mode": sts.operating_mode, "protective": sts.protective_torque,
    "protection_10ms": sts.protection_time, "overload": sts.overload_torque, "speed_p": sts.velocity_p,
    "overcurrent_10ms": sts.overcurrent_time, "speed_i": sts.velocity_i, "acceleration": sts.acceleration,
    "goal": sts.goal_position, "pwm": sts.goal_time, "speed": sts.goal_velocity, "torque_limit": sts.torque_limit,
    "quiet_counts": sts.moving_threshold, "d_ms": sts.dts, "default_acceleration": sts.max_acceleration,
    "acceleration_factor": sts.acceleration_multiplier, "max_temperature": sts.max_temperature,
    "max_voltage": sts.max_voltage, "min_voltage": sts.min_voltage,
}  # fmt: skip


def byte() -> st.SearchStrategy[int]:
    return st.integers(0, 255)


REGISTER_VALUES = st.fixed_dictionaries(
    {"mode": st.sampled_from([0, 0, 0, 1, 2, 3, 5]), "offset": st.integers(-2047, 2047)},
    optional={
        "phase": st.sampled_from([0, 4, 8, 12, 28]), "unloading": byte(), "p": byte(), "d": byte(), "i": byte(),
        "punch": byte(), "i_limit": byte(), "dead_above": byte(), "dead_below": byte(),
        "current_limit": st.integers(0, 500), "resolution": st.integers(1, 4), "min_position": st.integers(0, 4095),
        "max_position": st.integers(0, 4095), "protective": byte(), "protection_10ms": st.integers(0, 60),
        "overload": st.one_of(st.integers(0, 30), st.integers(0, 100)), "speed_p": byte(), "speed_i": byte(),
        "overcurrent_10ms": st.integers(0, 60),
        "acceleration": st.integers(0, 100), "torque_limit": st.integers(0, 1100), "quiet_counts": st.integers(0, 9),
        "d_ms": st.integers(0, 40), "acceleration_factor": st.integers(0, 3), "max_temperature": st.integers(20, 70),
        "max_voltage": st.integers(100, 140), "min_voltage": st.integers(40, 130),
    },
)  # fmt: skip


@dataclass(frozen=True)
class Event:
    """An event: goal, torque switch, load, voltage, a failing encoder, or forced turning in counts/s."""

    at_ms: int
    kind: str
    value: int


EVENTS = st.lists(
    st.one_of(
        st.builds(Event, st.integers(0, 1999), st.just("goal"), st.integers(-6000, 6000)),
        st.builds(Event, st.integers(0, 1999), st.just("torque"), st.sampled_from([0, 1, 2, 3])),
        st.builds(Event, st.integers(0, 1999), st.just("load"), st.integers(-3000, 3000)),
        st.builds(Event, st.integers(0, 1999), st.just("voltage"), st.integers(70, 150)),
        st.builds(Event, st.integers(0, 1999), st.just("heat"), st.integers(15, 75)),
        st.builds(Event, st.integers(0, 1999), st.just("encoder"), st.sampled_from([0, 1])),
        st.builds(Event, st.integers(0, 999), st.just("turn"), st.sampled_from([-400, -150, -90, 0, 60, 130, 300])),
        st.builds(Event, st.integers(1500, 1999), st.just("free"), st.just(0)),
    ),
    max_size=10,
    unique_by=lambda event: event.at_ms,
)
GOALS = {0: "goal", 3: "goal", 1: "speed", 2: "pwm"}


class Pair:
    """Both implementations. The compiled servo moves the shaft, and the plain servo only observes it."""

    def __init__(self, registers: dict[str, int], angle_rad: float) -> None:
        self.servo = VirtualServo(sts.STS3215, 1)
        for name, value in registers.items():
            self.put(name, value)
        self.servo.firmware.restart()
        self.servo.firmware.observe(angle_rad)
        own = {**registers, "torque": 0}
        self.plain = PlainServo(
            Settings(**own), angle_rad, STS3215_12V.torque_constant_nm_a, STS3215_12V.back_emf_v_s,
            STS3215_12V.resistance_ohm,
        )  # fmt: skip
        self.angle, self.velocity = angle_rad, 0.0
        self.load_nm, self.voltage_v = 0.0, 12.0
        self.forced_rad_s: float | None = None

    def put(self, name: str, value: int) -> None:
        self.servo.memory.put(REGISTERS[name], value)

    def get(self, register: Register) -> int:
        return register.decode(self.servo.read(register.address, register.size), "little")

    def happen(self, event: Event) -> None:
        if event.kind == "load":
            self.load_nm = event.value / 1000
        elif event.kind == "voltage":
            self.voltage_v = event.value / 10
        elif event.kind == "heat":
            self.servo.firmware.temperature_c = float(event.value)
        elif event.kind == "encoder":
            self.servo.firmware.encoder_fails = self.plain.encoder.fails = bool(event.value)
        elif event.kind == "turn":
            self.forced_rad_s = event.value * 2 * pi / 4096
        elif event.kind == "free":
            self.forced_rad_s = None
        elif event.kind == "torque":
            self.servo.write(sts.torque_enable.address, bytes((event.value,)))
            self.plain.settings.torque = event.value
        elif name := GOALS.get(self.plain.settings.mode):
            value = event.value % 1000 if name == "pwm" else event.value
            self.servo.write(REGISTERS[name].address, REGISTERS[name].encode(value, "little"))
            setattr(self.plain.settings, name, value)
            self.plain.write_goal()

    def step(self) -> None:
        firmware = self.servo.firmware
        firmware.voltage_v = self.voltage_v
        # The temperature belongs to the motor, not to the firmware, so the plain servo is given its value.
        temperature = int(firmware.temperature_c + 0.5)
        torque = self.servo.step(DT_S, self.angle, self.velocity)
        plain_torque = self.plain.step(self.angle, self.velocity, self.voltage_v, temperature)
        assert torque == pytest.approx(plain_torque, abs=1e-9)
        force = torque + self.load_nm - FRICTION * np.sign(self.velocity)
        self.velocity = max(-30.0, min(30.0, self.velocity + force / INERTIA * DT_S))
        if self.forced_rad_s is not None:
            self.velocity = self.forced_rad_s
        self.angle += self.velocity * DT_S

    def compare(self) -> None:
        plain = self.plain
        assert self.get(sts.present_load) == plain.drive
        assert self.get(sts.present_position) == plain.shown_position
        assert self.get(sts.status) == plain.guard.status
        assert self.get(sts.torque_enable) == plain.settings.torque
        speed = plain.encoder.speed * (50 if plain.settings.phase & 4 else 1)
        # After an encoder failure the position jumps, and 15 bits cannot hold this speed.
        assert self.get(sts.present_velocity) == int(np.sign(speed)) * (abs(speed) & 0x7FFF)
        assert self.get(sts.moving) == plain.moving
        assert self.servo.firmware.setpoint * 10000 == pytest.approx(plain.profile.place, abs=0.5)


@pytest.mark.slow
@settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.too_slow])
@given(REGISTER_VALUES, EVENTS, st.floats(0.0, 6.28))
def test_the_compiled_servo_matches_the_plain_one(
    registers: dict[str, int], events: list[Event], angle_rad: float
) -> None:
    pair = Pair(registers, angle_rad)
    due: dict[int, list[Event]] = {}
    for event in events:
        due.setdefault(event.at_ms, []).append(event)
    for ms in range(2000):
        for event in due.get(ms, ()):
            pair.happen(event)
        pair.step()
        pair.compare()


def test_python_and_machine_code_give_the_same_result() -> None:
    """``py_func`` runs on a record array."""
    written: Any = kernel.step
    compiled_states = sts_states(STS3215_12V, StsVariant())
    StsMemory(sts.STS3215, 1, compiled_states)
    settings_at_power_on = {"windows_s": 50, "window_ms": 20, "lowest_counts_s": 50, "highest_counts_s": 7500}
    for name, value in {**settings_at_power_on, "noted": 1 | 4 | 16}.items():
        compiled_states[name] = value
    compiled_states["table"][0][42] = 100
    plain_states = compiled_states.copy().view(np.recarray)
    for _ in range(30):
        compiled = kernel.step(compiled_states, DT_S, 0.0, 0.0, 12.0)
        assert written.py_func(plain_states, DT_S, 0.0, 0.0, 12.0) == compiled
    assert compiled_states.tobytes() == plain_states.tobytes()
    assert compiled[0] > 0.1
