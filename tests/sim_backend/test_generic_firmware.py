"""Internals of servos other than STS: the motion profile and the temperature of the motor."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.servos import sts
from sim_backend.mechanics.motor import MotorConstants, Thermometer
from sim_backend.servos.generic.motion_profile import UNLIMITED, MotionProfile

DT_S = 0.001


def _profile(speed: float, acceleration: float) -> MotionProfile:
    profile = MotionProfile()
    profile.speed, profile.acceleration = speed, acceleration
    return profile


@settings(deadline=None)
@given(
    goal=st.integers(-4095, 4095),
    speed=st.integers(50, 3000),
    acceleration=st.integers(1, 254).map(lambda units: units * 100),
)
def test_the_profile_duration_matches_feetechs_formula(goal: int, speed: int, acceleration: int) -> None:
    profile = _profile(speed, acceleration)
    profile.goal = goal
    ramp_s, distance = speed / acceleration, abs(goal)
    # Feetech's examples give the duration |distance| / V + V / A. A short motion never reaches V.
    expected_s = distance / speed + ramp_s
    if distance < speed * ramp_s:
        expected_s = 2.0 * (distance / acceleration) ** 0.5
    elapsed_s, fastest, last = 0.0, 0.0, 0.0
    while not profile.done and elapsed_s < expected_s + 1.0:
        profile.step(DT_S)
        elapsed_s += DT_S
        fastest = max(fastest, abs(profile.velocity))
        assert abs(profile.velocity - last) <= acceleration * DT_S + 1e-6
        last = profile.velocity
    assert profile.position == goal
    assert fastest <= speed + 1e-9
    assert elapsed_s == pytest.approx(expected_s, abs=0.004 + 2.0 * DT_S)


@settings(deadline=None)
@given(st.lists(st.integers(0, 4095), min_size=1, max_size=6), st.integers(1, 254))
def test_changing_goals_never_violate_the_limits(goals: list[int], units: int) -> None:
    profile = _profile(1000.0, units * 100.0)
    velocity = 0.0
    for goal in goals:
        profile.goal = goal
        for _ in range(50):
            profile.step(DT_S)
            assert abs(profile.velocity) <= 1000.0 + 1e-9
            assert abs(profile.velocity - velocity) <= units * 100.0 * DT_S + 1e-6
            velocity = profile.velocity


def test_without_acceleration_the_profile_is_a_ramp() -> None:
    profile = _profile(1000.0, UNLIMITED)
    profile.goal = 100.0
    for _ in range(100):
        profile.step(DT_S)
    assert profile.position == 100.0
    profile.step(DT_S)
    assert profile.done


def test_a_stalled_motor_heats_up_according_to_its_constants() -> None:
    motor = MotorConstants.of(sts.STS3215)
    thermometer = Thermometer(motor)
    for _ in range(60_000):
        thermometer.step(0.01, 1.35)
    # The published test shows about 15 K after ten minutes at half the stall torque.
    assert thermometer.temperature_c - motor.ambient_c == pytest.approx(15.0, abs=2.0)
