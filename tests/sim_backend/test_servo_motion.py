"""Motion of a virtual STS servo: loops, profile, motor and torque switch. Simulated time only."""

import pytest

from drivers.servos import sts
from drivers.servos.register import Register
from sim_backend.servos.sts.firmware import StsVariant
from tests.sim_backend.sts_bench import COUNTS_PER_RAD, StsBench


def _free(bench: StsBench) -> None:
    """Remove the acceleration limit."""
    bench[sts.acceleration_multiplier] = 0
    bench.run(0.001)


# Position mode


def test_the_stiffness_matches_the_position_loop() -> None:
    """At P = 32, the drive is 8 units per count beyond a dead zone of 1 count, plus 16 units of startup force. One unit
    is 1/1000 of full drive."""
    bench = StsBench()
    bench[sts.position_d] = 0
    bench.go(2048)
    bench.held_at(2038, 0.1)
    assert bench[sts.present_load] == -(9 * 8 + 16)
    bench.held_at(2058, 0.1)
    assert abs(bench[sts.present_load] - (9 * 8 + 16)) <= 8  # a falling count is exact, a rising count is one short


@pytest.mark.parametrize("way", [1, -1])
def test_the_sign_bit_of_the_load_is_set_when_it_pushes_to_larger_counts(way: int) -> None:
    bench = StsBench()
    bench.go(2048 + 300 * way)
    bench.held_at(2048, 0.3)
    assert bench[sts.present_load] == -970 * way
    assert bool(bench.servo.read(61, 1)[0] & 4) == (way > 0)


def test_the_current_has_no_sign() -> None:
    bench = StsBench()
    for goal in (2348, 1748):
        bench.go(goal)
        bench.held_at(2048, 0.6)
        assert bench[sts.present_current] == pytest.approx(2.7 * 0.97 / 0.0065, rel=0.01)


def test_a_load_of_one_newton_meter_sags_by_forty_counts() -> None:
    bench = StsBench(load_nm=-1.0)
    bench.go(2048)
    bench.run(2.0)
    assert 39 <= 2048 - bench[sts.present_position] <= 43


def test_the_integral_grows_only_at_rest_and_corrects_the_sag() -> None:
    bench = StsBench(load_nm=-1.0)
    bench[sts.position_i] = 5
    bench.go(2048)
    bench.run(4.0)
    assert 2048 - bench[sts.present_position] <= 3
    bench[sts.position_i] = 0
    bench.run(1.0)
    assert 2048 - bench[sts.present_position] >= 30


def test_the_integral_stops_at_its_limit_and_reverses_at_once() -> None:
    bench = StsBench()
    for register, value in ((sts.position_p, 0), (sts.position_d, 0), (sts.position_i, 100), (sts.integral_limit, 10)):
        bench[register] = value
    _free(bench)
    bench.go(2148)
    bench.held_at(2048, 1.0)
    assert bench[sts.present_load] == -(40 + 16)
    bench.go(1948)
    bench.held_at(2048, 0.05)
    assert bench[sts.present_load] == 40 + 16


def test_the_torque_limit_clips_the_drive_and_max_torque_does_not() -> None:
    bench = StsBench()
    bench[sts.max_torque] = 100
    bench[sts.torque_limit] = 300
    bench.go(3000)
    bench.held_at(2048, 0.5)
    assert bench[sts.present_load] == -300


def test_the_profile_keeps_and_reports_speed_and_acceleration() -> None:
    bench = StsBench()
    bench[sts.acceleration] = 50
    bench[sts.goal_velocity] = 1000
    bench.go(3048)
    bench.run(0.1)
    assert int.from_bytes(bench.servo.read(71, 2), "little") == pytest.approx(550, abs=10)  # from 50 on
    bench.run(0.5)
    assert int.from_bytes(bench.servo.read(71, 2), "little") == 1000
    assert bench[sts.present_velocity] == pytest.approx(1000, abs=100)
    assert bench[sts.present_velocity] % 50 == 0
    assert bench[sts.present_target] > bench[sts.present_position]
    assert bench[sts.moving] == 1
    bench.run(1.0)
    assert bench[sts.present_target] == 3048
    assert bench[sts.present_position] == pytest.approx(3048, abs=4)
    assert (bench[sts.moving], bench[sts.present_velocity]) == (0, 0)


@pytest.mark.parametrize(
    ("registers", "counts_s2"),
    [({}, 10_000), ({sts.max_acceleration: 254}, 25_400), ({sts.acceleration: 20}, 2_000)],
)
def test_acceleration_0_means_register_85_times_86(registers: dict[Register, int], counts_s2: int) -> None:
    bench = StsBench()
    for register, value in registers.items():
        bench[register] = value
    bench.run(0.001)
    bench.go(3048)
    bench.run(0.1)
    assert int.from_bytes(bench.servo.read(71, 2), "little") == pytest.approx(50 + counts_s2 * 0.1, rel=0.05)


@pytest.mark.parametrize(("asked", "kept"), [(99, 99), (100, 100), (101, 100), (254, 100)])
def test_an_acceleration_above_register_85_is_clipped(asked: int, kept: int) -> None:
    bench = StsBench()
    bench[sts.acceleration] = asked
    assert bench[sts.acceleration] == kept


@pytest.mark.parametrize(("asked", "kept"), [(0, 7500), (9000, 7500), (1, 50), (-400, 400)])
def test_speeds_are_clipped_to_factory_limits_and_zero_means_maximum(asked: int, kept: int) -> None:
    bench = StsBench()
    _free(bench)
    bench[sts.goal_velocity] = asked
    bench.run(0.001)
    bench.go(2548)
    assert int.from_bytes(bench.servo.read(71, 2), "little") == kept


def test_speed_0_without_its_phase_bit_means_no_motion() -> None:
    bench = StsBench()
    bench[sts.phase] = 4
    bench.go(3000)
    bench.run(0.5)
    assert bench[sts.present_position] == pytest.approx(2048, abs=2)


def test_the_speed_unit_is_fifty_counts_without_its_phase_bit() -> None:
    bench = StsBench()
    bench[sts.phase] = 8
    bench[sts.goal_velocity] = 10
    bench.run(0.001)
    bench.go(3000)
    bench.run(0.5)
    assert bench.servo.firmware.setpoint == pytest.approx(2048 + 250, abs=20)
    assert bench[sts.present_velocity] == pytest.approx(10, abs=2)


def test_a_new_goal_during_a_motion_brakes_first_and_then_returns() -> None:
    bench = StsBench()
    bench[sts.acceleration] = 20
    bench[sts.goal_velocity] = 1000
    bench.go(3500)
    bench.run(1.0)
    turning = bench.servo.firmware.setpoint
    bench.go(2100)
    bench.run(0.2)
    assert bench.servo.firmware.setpoint > turning
    bench.run(3.0)
    assert bench.servo.firmware.setpoint == 2100


@pytest.mark.parametrize(("goal", "reached"), [(100, 1000), (4000, 3000), (2500, 2500)])
def test_position_limits_clip_the_goal_but_not_its_register(goal: int, reached: int) -> None:
    bench = StsBench()
    bench[sts.min_position] = 1000
    bench[sts.max_position] = 3000
    bench.run(0.001)
    bench.go(goal)
    bench.run(2.0)
    assert bench[sts.present_position] == pytest.approx(reached, abs=3)
    assert bench[sts.goal_position] == goal


def test_equal_limits_allow_goals_beyond_a_turn() -> None:
    bench = StsBench()
    bench[sts.max_position] = 0
    bench[sts.phase] = 12 | 16
    bench.run(0.001)
    bench.go(-3000)
    bench.run(4.0)
    assert bench[sts.present_position] == pytest.approx(-3000, abs=4)


def test_the_resolution_multiplies_the_goal() -> None:
    bench = StsBench()
    bench[sts.angular_resolution] = 3
    bench.run(0.001)
    bench.go(800)
    bench.run(2.0)
    assert bench[sts.present_position] == pytest.approx(2400, abs=3)


def test_a_shaft_pushed_across_the_seam_returns_the_same_way() -> None:
    bench = StsBench()
    bench.turn_to(4000)
    bench.run(0.1)
    bench.go(4000)
    for count in range(4000, 4200):
        bench.held_at(count, 0.005)
    assert bench[sts.present_position] == pytest.approx(4199 - 4096, abs=2)
    bench.run(1.0)
    assert bench.plant.angles()[0] * COUNTS_PER_RAD == pytest.approx(4001, abs=4)


def test_the_homing_offset_applies_at_once_and_the_goal_number_stays() -> None:
    bench = StsBench()
    bench[sts.homing_offset] = -300
    bench.run(0.001)
    assert bench[sts.present_position] == 2348
    bench.go(2348)
    bench.run(0.1)
    bench[sts.homing_offset] = 0
    bench.run(0.002)
    assert bench[sts.present_position] == pytest.approx(2048, abs=2)
    bench.run(1.0)
    assert bench[sts.present_position] == pytest.approx(2348, abs=3)


# The torque switch


def test_without_torque_a_load_falls() -> None:
    bench = StsBench(load_nm=-0.3)
    bench.run(0.3)
    assert bench[sts.present_position] < 1900
    assert (bench[sts.present_load], bench[sts.moving]) == (0, 0)


def test_damping_slows_a_falling_load_without_drive() -> None:
    free, damped = StsBench(load_nm=-0.3), StsBench(load_nm=-0.3)
    damped[sts.torque_enable] = 2
    for bench in (free, damped):
        bench.run(0.5)
        assert bench[sts.present_load] == 0
    assert abs(damped.plant.velocities()[0]) < 0.2 * abs(free.plant.velocities()[0])


@pytest.mark.parametrize(
    ("mode", "register", "value"),
    [(0, sts.goal_position, 2500), (3, sts.goal_position, 100), (1, sts.goal_velocity, 500), (2, sts.goal_time, 300)],
)
def test_a_write_of_the_modes_goal_enables_the_torque(mode: int, register: Register, value: int) -> None:
    bench = StsBench()
    bench[sts.operating_mode] = mode
    bench.run(0.1)
    before = bench.plant.angles()[0]
    bench[register] = value
    bench.run(0.2)
    assert bench[sts.torque_enable] == 1
    assert bench.plant.angles()[0] != before


def test_a_firmware_variant_whose_goals_do_not_enable_the_torque() -> None:
    bench = StsBench(variant=StsVariant(goal_write_energises=False))
    bench.go(2500)
    bench.run(0.2)
    assert (bench[sts.torque_enable], bench[sts.present_position]) == (0, 2048)


def test_enabling_the_torque_holds_the_position_and_ignores_the_goal() -> None:
    bench = StsBench()
    bench[sts.torque_enable] = 1
    bench.run(0.5)
    assert bench[sts.goal_position] == 0
    assert bench[sts.present_position] == 2048


def test_a_firmware_variant_that_moves_to_a_stale_goal_at_torque_on() -> None:
    bench = StsBench(variant=StsVariant(torque_on_takes_goal=True))
    bench[sts.torque_enable] = 1
    bench.run(1.5)
    assert bench[sts.present_position] == pytest.approx(0, abs=3)


@pytest.mark.parametrize("forgets", [True, False])
def test_another_write_within_the_millisecond_discards_the_goal(forgets: bool) -> None:
    bench = StsBench(variant=StsVariant(forgets_goal_within_tick=forgets))
    bench[sts.goal_position] = 2500
    bench[sts.torque_limit] = 900
    bench.run(1.0)
    assert bench[sts.goal_position] == 2500
    assert bench[sts.present_position] == (2048 if forgets else pytest.approx(2500, abs=3))


# The other modes


def test_speed_mode_turns_at_the_requested_speed_and_reports_the_raw_angle() -> None:
    bench = StsBench()
    bench[sts.homing_offset] = 100
    bench[sts.operating_mode] = 1
    bench.run(0.002)
    for speed in (1000, -600):
        bench[sts.goal_velocity] = speed
        bench.run(2.0)
        assert bench[sts.present_velocity] == pytest.approx(speed, abs=50)
        assert bench[sts.moving] == 1
        raw = bench.plant.angles()[0] * COUNTS_PER_RAD % 4096
        assert bench[sts.present_position] == pytest.approx(raw, abs=10)


def test_pwm_mode_applies_the_drive_within_the_torque_limit() -> None:
    bench = StsBench()
    bench[sts.operating_mode] = 2
    bench.run(0.001)
    bench[sts.goal_time] = 400
    bench.run(0.3)
    assert bench[sts.present_load] == 400
    assert bench.plant.velocities()[0] < -1.0
    bench[sts.torque_limit] = 250
    bench.run(0.002)
    assert bench[sts.present_load] == 250
    bench[sts.torque_enable] = 0
    bench.run(0.002)
    assert bench[sts.present_load] == 0


def test_step_mode_moves_from_the_last_goal_and_reports_the_rest() -> None:
    bench = StsBench()
    bench[sts.operating_mode] = 3
    bench[sts.max_position] = 0
    bench.run(0.002)
    for _ in range(3):
        bench.go(200)
        assert bench[sts.present_position] > 150
        bench.run(0.5)
        assert abs(bench[sts.present_position]) <= 3
    assert bench.servo.firmware.position == pytest.approx(2648, abs=4)


def test_unknown_modes_do_not_drive_the_motor() -> None:
    bench = StsBench()
    bench[sts.operating_mode] = 7
    bench[sts.goal_position] = 3000
    bench[sts.torque_enable] = 1
    bench.run(0.3)
    assert (bench[sts.present_load], bench[sts.present_position]) == (0, 2048)


def test_a_change_of_mode_resets_torque_turns_speed_and_acceleration() -> None:
    bench = StsBench()
    bench.turn_to(4096 + 500)
    bench.run(0.1)
    bench[sts.acceleration] = 10
    bench[sts.goal_velocity] = 500
    bench.run(0.002)
    bench.go(600)
    bench[sts.operating_mode] = 1
    assert [bench[r] for r in (sts.torque_enable, sts.acceleration, sts.goal_velocity)] == [0, 0, 0]
    bench[sts.operating_mode] = 0
    bench.run(0.1)
    assert 0 <= bench.servo.firmware.position < 4096


# What it reports


def test_slow_speeds_read_as_0_and_others_as_multiples_of_50() -> None:
    bench = StsBench()
    for counts_s, told in ((40, {0}), (90, {0, 100}), (130, {100, 150}), (1020, {1000, 1050})):
        seen = set()
        for ms in range(300):
            bench.turn_to(1000 + counts_s * ms / 1000)
            bench.rig.step()
            if ms > 60:
                seen.add(bench[sts.present_velocity])
        assert seen <= told, counts_s


def test_a_shaft_turned_by_hand_does_not_report_moving() -> None:
    bench = StsBench()
    for ms in range(200):
        bench.turn_to(1000 + ms)
        bench.rig.step()
        assert bench[sts.moving] == 0


def test_a_servo_starts_at_ambient_temperature() -> None:
    assert StsBench()[sts.present_temperature] == 27


@pytest.mark.parametrize("timestep_s", [0.0005, 0.002, 0.0007])
def test_the_firmware_rate_does_not_depend_on_the_timestep_of_the_plant(timestep_s: float) -> None:
    bench = StsBench(load_nm=-1.0, timestep_s=timestep_s)
    bench[sts.goal_velocity] = 500
    bench.run(0.003)
    bench.go(2248)
    bench.run(0.2)
    assert bench.servo.firmware.setpoint - 2048 == pytest.approx(85, abs=10)
    bench.run(2.0)
    assert 39 <= 2248 - bench[sts.present_position] <= 43
