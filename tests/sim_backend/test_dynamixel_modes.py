"""Operating modes of virtual X servos, as the e-manual describes them."""

import pytest

from drivers.servos import x
from drivers.servos.register import Register
from sim_backend.servos.dynamixel.modes import CURRENT, CURRENT_POSITION, PWM, VELOCITY
from tests.sim_backend.dynamixel_bench import Bench

DATA_RANGE = 4


def bench_in(mode: int, model: x.XModel = x.XL330_M288, load_nm: float = 0.0) -> Bench:
    """Return a servo in this mode with torque enabled."""
    bench = Bench(model, load_nm=load_nm)
    bench.write_all({x.operating_mode: mode, x.torque_enable: 1})
    return bench


@pytest.mark.parametrize("model", x.MODELS.values(), ids=lambda model: model.name)
def test_a_model_without_current_refuses_the_modes_that_need_it(model: x.XModel) -> None:
    bench = Bench(model)
    refused = [0, 5] if model.current_unit_a is None else []
    assert [mode for mode in (0, 1, 3, 4, 5, 16) if bench.write(x.operating_mode, mode) == DATA_RANGE] == refused
    assert bench.write(x.operating_mode, 2) == DATA_RANGE


@pytest.mark.parametrize("model", [x.XL330_M288, x.XM430_W350], ids=lambda model: model.name)
@pytest.mark.parametrize("mode", [x.EXTENDED_POSITION_MODE, CURRENT_POSITION])
def test_position_modes_beyond_a_turn_reach_their_goal(mode: int, model: x.XModel) -> None:
    bench = bench_in(mode, model)
    for goal in (2600, 7000, -3000):
        bench.write_all({x.goal_position: goal})
        bench.run(4.0)
        assert bench.read(x.present_position) == pytest.approx(goal, abs=40)


@pytest.mark.parametrize("model", [x.XL430_W250, x.XL330_M288, x.XM430_W350], ids=lambda model: model.name)
@pytest.mark.parametrize("goal", [40, -40, 100])
def test_velocity_mode_turns_at_the_goal_velocity(goal: int, model: x.XModel) -> None:
    bench = bench_in(VELOCITY, model)
    bench.run(0.3)
    assert bench.read(x.present_velocity) == 0, "the goal is 0 until one is written"
    bench.write_all({x.goal_velocity: goal})
    bench.run(3.0)
    assert bench.read(x.present_velocity) == pytest.approx(goal, abs=2)
    bench.write_all({x.goal_velocity: 0})
    bench.run(2.0)
    assert bench.read(x.present_velocity) == pytest.approx(0, abs=1)


def test_velocity_mode_reaches_its_goal_with_the_profile_acceleration() -> None:
    bench = bench_in(VELOCITY, x.XL430_W250)
    bench.write_all({x.profile_acceleration: 2, x.goal_velocity: 100})  # 429 rpm per minute: 7.2 rpm/s
    bench.run(1.0)
    assert bench.read(x.velocity_trajectory) == pytest.approx(31, abs=2)


def test_full_pwm_without_load_is_not_an_overload() -> None:
    bench = bench_in(PWM, x.XL430_W250)
    bench.write_all({x.goal_pwm: 885})
    bench.run(4.0)
    assert (bench.read(x.hardware_error_status), bench.read(x.torque_enable)) == (0, 1)


@pytest.mark.parametrize("goal", [300, -300])
def test_pwm_mode_applies_the_goal_pwm(goal: int) -> None:
    bench = bench_in(PWM, x.XL430_W250)
    bench.run(0.2)
    assert (bench.read(x.present_pwm), bench.read(x.present_velocity)) == (0, 0)
    bench.write_all({x.goal_pwm: goal})
    bench.run(1.0)
    assert bench.read(x.present_pwm) == goal
    assert bench.read(x.present_velocity) * goal > 0


def test_an_x330_changes_its_pwm_with_the_pwm_slope() -> None:
    """At 5 V and with the factory slope, it takes 18 ms to reach full PWM."""
    bench = bench_in(PWM)
    bench.write_all({x.goal_pwm: 885})
    bench.run(0.008)
    assert 300 < bench.read(x.present_pwm) < 600
    bench.run(0.02)
    assert bench.read(x.present_pwm) == 885


@pytest.mark.parametrize("goal", [150, -150])
def test_current_mode_applies_the_goal_current(goal: int) -> None:
    bench = bench_in(CURRENT)
    bench.run(0.2)
    assert bench.read(x.present_current) == 0
    bench.write_all({x.goal_current: goal})
    bench.run(0.02)
    assert bench.read(x.present_current) == pytest.approx(goal, abs=2)
    assert bench.read(x.present_velocity) * goal > 0


def test_the_goal_current_limits_the_torque_of_current_based_position_mode() -> None:
    load_nm = 0.25
    strong = bench_in(CURRENT_POSITION, load_nm=load_nm)
    weak = bench_in(CURRENT_POSITION, load_nm=load_nm)
    weak.write_all({x.goal_current: 200})
    weak.run(0.05)
    assert abs(weak.read(x.present_current)) == pytest.approx(200, abs=2)
    for bench in (strong, weak):
        bench.run(1.0)
    assert abs(strong.read(x.present_position) - 2048) < 250
    assert abs(weak.read(x.present_position) - 2048) > 1000


def test_a_change_of_mode_resets_gains_profile_and_limits() -> None:
    bench = Bench(x.XM430_W350)
    changed: dict[Register, int] = {
        x.velocity_i_gain: 1, x.velocity_p_gain: 2, x.position_d_gain: 3, x.position_i_gain: 4, x.position_p_gain: 5,
        x.feedforward_2nd_gain: 6, x.feedforward_1st_gain: 7, x.profile_acceleration: 8, x.profile_velocity: 9,
        x.goal_pwm: 10, x.goal_current: 11,
    }  # fmt: skip
    factory = {register: bench.read(register) for register in changed}
    bench.write_all(changed)
    bench.write_all({x.operating_mode: x.POSITION_MODE})
    assert {register: bench.read(register) for register in changed} == changed, "the mode has not changed"
    bench.write_all({x.operating_mode: CURRENT_POSITION})
    assert {register: bench.read(register) for register in changed} == factory
    assert (factory[x.goal_pwm], factory[x.goal_current]) == (885, 1193)
