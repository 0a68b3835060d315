"""How a virtual servo moves its shaft: profile, loop, motor, protection. Simulated time only."""

from math import pi

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.servos import sts
from drivers.servos.register import Register
from sim_backend.motion_profile import UNLIMITED, MotionProfile
from sim_backend.motor import MotorConstants, Thermometer
from sim_backend.plant import BenchPlant
from sim_backend.rig import Rig
from sim_backend.servo import VirtualServo

DT_S = 0.001
COUNTS_PER_RAD = 4096 / (2 * pi)


class Bench:
    """One servo with a load, and the registers by name."""

    def __init__(self, load_nm: float = 0.0) -> None:
        self.plant = BenchPlant([1])
        self.plant.load_nm = [load_nm]
        self.servo = VirtualServo(sts.STS3215, 1)
        self.rig = Rig([self.servo], self.plant)

    def __setitem__(self, register: Register, value: int) -> None:
        self.servo.write(register.address, register.encode(value, "little"))

    def __getitem__(self, register: Register) -> int:
        return register.decode(self.servo.read(register.address, register.size), "little")

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / DT_S)):
            self.rig.step()

    def hold(self) -> None:
        self[sts.goal_position] = self[sts.present_position]
        self[sts.torque_enable] = 1


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
def test_the_profile_takes_the_time_of_feetechs_formula(goal: int, speed: int, acceleration: int) -> None:
    profile = _profile(speed, acceleration)
    profile.goal = goal
    ramp_s, distance = speed / acceleration, abs(goal)
    # Feetech's examples give |distance| / V + V / A; too short a way never reaches V.
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
def test_changing_goals_never_break_the_limits(goals: list[int], units: int) -> None:
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


def test_the_shaft_follows_the_profile_and_reports_it() -> None:
    bench = Bench()
    bench.hold()
    bench[sts.acceleration] = 50
    bench[sts.goal_velocity] = 1000
    bench[sts.goal_position] = 3048
    bench.run(0.6)
    assert bench[sts.present_velocity] == pytest.approx(1000, abs=120)
    assert bench[sts.moving] == 1
    bench.run(1.0)  # 1000 / 1000 + 1000 / 5000 s, and a little to settle
    assert bench[sts.present_position] == pytest.approx(3048, abs=3)
    assert bench[sts.moving] == 0
    assert abs(bench[sts.present_velocity]) < 20


def test_a_steady_motion_lags_by_some_milliseconds() -> None:
    bench = Bench()
    bench.hold()
    speed = round(2.0 * COUNTS_PER_RAD)
    bench[sts.goal_velocity] = speed
    bench[sts.goal_position] = 4000
    bench.run(0.5)
    firmware = bench.servo.firmware
    lag_s = (firmware.profile.position - firmware.position) / speed
    assert 0.010 < lag_s < 0.020


@pytest.mark.parametrize(("goal", "reached"), [(100, 1000), (4000, 3000), (2500, 2500)])
def test_the_position_limits_clamp_the_goal(goal: int, reached: int) -> None:
    bench = Bench()
    bench[sts.min_position] = 1000
    bench[sts.max_position] = 3000
    bench.hold()
    bench[sts.goal_position] = goal
    bench.run(2.0)
    assert bench[sts.present_position] == pytest.approx(reached, abs=3)


def test_the_homing_offset_moves_the_frame_not_the_shaft() -> None:
    bench = Bench()
    bench[sts.homing_offset] = -300
    assert bench[sts.present_position] == 2348
    bench.hold()
    bench.run(0.5)
    assert bench.plant.angles()[0] == pytest.approx(2048.5 / COUNTS_PER_RAD, abs=0.005)


def test_without_torque_nothing_moves_against_gravity() -> None:
    bench = Bench(load_nm=-0.3)
    bench.servo.goal_write_energises = False
    bench[sts.goal_position] = 3000
    highest = bench.plant.angles()[0]
    for _ in range(300):
        bench.rig.step()
        angle = bench.plant.angles()[0]
        assert angle <= highest
        highest = angle
    assert highest < 3.0
    assert bench[sts.present_load] == 0


def test_gear_friction_holds_a_small_load() -> None:
    bench = Bench(load_nm=0.05)
    bench.run(0.5)
    assert bench.plant.velocities() == [0.0]


def test_torque_on_goes_for_the_goal_even_a_stale_one() -> None:
    bench = Bench()
    bench[sts.torque_enable] = 1
    bench.run(0.2)
    assert bench[sts.present_position] < 2000


def test_the_torque_limit_limits() -> None:
    bench = Bench(load_nm=-1.0)
    bench.hold()
    bench.run(0.3)
    assert bench[sts.present_position] == pytest.approx(2048, abs=20)
    bench[sts.torque_limit] = 200
    bench.run(0.3)
    assert bench[sts.present_position] < 2000
    assert bench[sts.present_load] == 200


def test_a_load_shows_in_load_current_and_voltage() -> None:
    bench = Bench(load_nm=-1.5)
    bench.hold()
    bench.run(0.5)
    assert bench[sts.present_load] == pytest.approx(510, abs=60)
    assert bench[sts.present_current] * 6.5e-3 == pytest.approx(2.7 / 2, abs=0.15)
    assert bench[sts.present_voltage] in {119, 120}


def _stalled(bench: Bench) -> None:
    """Push against something that does not give way."""
    bench.hold()
    bench.plant.load_nm = [-20.0]
    bench.plant.place([2048.5 / COUNTS_PER_RAD])
    bench[sts.goal_position] = 2400
    for _ in range(2500):
        bench.plant.place([2048.5 / COUNTS_PER_RAD])
        bench.rig.step()


def test_overload_drops_to_protective_torque_and_latches() -> None:
    bench = Bench()
    _stalled(bench)
    assert bench[sts.status] == 1 << 5
    assert bench[sts.present_load] == 200
    assert bench.servo.read_status(0, 0)[4] == 1 << 5
    bench[sts.goal_position] = 2400  # the same direction again: still latched
    assert bench[sts.status] == 1 << 5


def test_a_goal_away_from_the_obstacle_ends_an_overload() -> None:
    bench = Bench()
    _stalled(bench)
    bench[sts.goal_position] = 2040
    assert bench[sts.status] == 0


def test_a_write_to_the_torque_switch_ends_an_overload() -> None:
    bench = Bench()
    _stalled(bench)
    bench[sts.torque_enable] = 0
    assert bench[sts.status] == 0


def test_overload_does_not_act_when_the_unloading_condition_leaves_it_out() -> None:
    bench = Bench()
    bench[sts.unloading_condition] = 0
    _stalled(bench)
    assert bench[sts.status] == 1 << 5
    assert bench[sts.present_load] == 1000


def test_too_low_a_voltage_is_reported() -> None:
    bench = Bench()
    bench[sts.min_voltage] = 125
    bench.run(0.02)
    assert bench[sts.status] == 1 << 0


def test_heat_releases_the_motor() -> None:
    bench = Bench(load_nm=-0.3)
    bench.hold()
    bench[sts.max_temperature] = 20
    bench.run(0.1)
    assert bench[sts.status] == 1 << 2
    assert bench[sts.present_load] == 0


def test_a_stalled_motor_heats_as_the_constants_say() -> None:
    motor = MotorConstants.of(sts.STS3215)
    thermometer = Thermometer(motor)
    for _ in range(60_000):
        thermometer.step(0.01, 1.35)
    # The published test: about 15 K after ten minutes at half the stall torque.
    assert thermometer.temperature_c - motor.ambient_c == pytest.approx(15.0, abs=2.0)


def test_it_starts_at_ambient() -> None:
    assert Bench()[sts.present_temperature] == 27
