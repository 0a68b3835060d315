"""Registers that change how a virtual X servo moves and reports, as the e-manual describes them."""

from math import radians

import pytest

from drivers.servos import x
from sim_backend.servos.dynamixel.modes import PWM, VELOCITY
from tests.sim_backend.dynamixel_bench import Bench, handler

DATA_RANGE = 4
REVERSE = 1


@pytest.mark.parametrize(("span_ms", "ramp_ms"), [(800, 0), (800, 200), (800, 700)])
@pytest.mark.parametrize("distance", [400, -1200])
def test_a_time_based_profile_ends_after_its_time(distance: int, span_ms: int, ramp_ms: int) -> None:
    bench = Bench()
    bench.write_all({
        x.drive_mode: x.TIME_BASED_PROFILE, x.profile_acceleration: ramp_ms, x.profile_velocity: span_ms,
        x.torque_enable: 1, x.goal_position: 2048 + distance,
    })  # fmt: skip
    bench.run(0.9 * span_ms / 1e3)
    assert bench.read(x.position_trajectory) != 2048 + distance
    bench.run(0.15 * span_ms / 1e3)
    assert bench.read(x.position_trajectory) == 2048 + distance


def test_a_time_based_profile_accelerates_for_at_most_half_of_its_time() -> None:
    bench = Bench()
    bench.write_all({
        x.drive_mode: x.TIME_BASED_PROFILE, x.profile_acceleration: 700, x.profile_velocity: 1000,
        x.torque_enable: 1, x.goal_position: 3048,
    })  # fmt: skip
    bench.run(0.5)
    assert bench.read(x.position_trajectory) == pytest.approx(2548, abs=15)
    assert bench.read(x.velocity_trajectory) * x.VELOCITY_UNIT_COUNTS_S == pytest.approx(2000, rel=0.03)


def test_a_time_based_profile_of_velocity_mode_is_the_time_to_the_goal() -> None:
    bench = Bench()
    bench.write_all({
        x.drive_mode: x.TIME_BASED_PROFILE, x.operating_mode: VELOCITY, x.profile_acceleration: 1000,
        x.torque_enable: 1, x.goal_velocity: 100,
    })  # fmt: skip
    bench.run(0.5)
    assert bench.read(x.velocity_trajectory) == pytest.approx(50, abs=2)


def test_firmware_before_42_has_no_time_based_profile() -> None:
    bench = Bench(firmware=41)
    bench.write_all({
        x.drive_mode: x.TIME_BASED_PROFILE, x.profile_velocity: 2000, x.torque_enable: 1, x.goal_position: 2148,
    })  # fmt: skip
    bench.run(0.3)
    assert bench.read(x.position_trajectory) == 2148


def test_reverse_mode_inverts_positions_and_drive_and_keeps_the_sign_of_the_offset() -> None:
    bench = Bench()
    start_rad = radians(30)
    bench.plant.place([start_rad])
    bench.run(0.05)
    bench.write_all({x.drive_mode: REVERSE})
    within = -round(start_rad * 4096 / radians(360)) % 4096
    assert bench.read(x.present_position) == pytest.approx(within, abs=1)
    bench.write_all({x.homing_offset: 200})
    assert bench.read(x.present_position) == pytest.approx(within + 200, abs=1)
    bench.write_all({x.homing_offset: 0, x.torque_enable: 1, x.goal_position: within - 400})
    bench.run(0.03)
    assert bench.read(x.present_pwm) < 0
    bench.run(2.0)
    assert bench.read(x.present_position) == pytest.approx(within - 400, abs=10)
    turned = (bench.plant.angles()[0] - start_rad) * 4096 / radians(360)
    assert turned == pytest.approx(400, abs=10)


@pytest.mark.parametrize(("drive_mode", "firmware", "on"), [(8, None, 1), (0, None, 0), (8, 44, 0)])
def test_a_goal_enables_the_torque_if_the_drive_mode_selects_it(drive_mode: int, firmware: int | None, on: int) -> None:
    bench = Bench(firmware=firmware)
    bench.write_all({x.drive_mode: drive_mode, x.profile_velocity: 50})
    assert bench.read(x.torque_enable) == 0
    bench.write_all({x.goal_position: 2300})
    assert bench.read(x.torque_enable) == on
    bench.run(2.0)
    assert (abs(bench.read(x.present_position) - 2300) < 15) == on


def test_the_bus_watchdog_stops_the_servo_and_locks_its_goals() -> None:
    bench = Bench()
    bench.write_all({x.operating_mode: VELOCITY, x.torque_enable: 1, x.goal_velocity: 60, x.bus_watchdog: 10})
    for _ in range(10):
        bench.run(0.15)
        handler.ping(bench.port, 7)  # any instruction on the bus restarts the timer
    assert (bench.read(x.bus_watchdog), bench.read(x.present_velocity) > 50) == (10, True)
    bench.run(0.25)
    assert bench.read(x.bus_watchdog) == 255
    bench.run(2.0)
    assert bench.read(x.present_velocity) == pytest.approx(0, abs=1)
    for goal in (x.goal_velocity, x.goal_position, x.goal_pwm):
        assert bench.write(goal, 10) == DATA_RANGE
    bench.write_all({x.bus_watchdog: 0, x.goal_velocity: 60})
    bench.run(1.5)
    assert bench.read(x.present_velocity) == pytest.approx(60, abs=2)


def test_the_bus_watchdog_holds_a_servo_in_position_mode_where_it_is() -> None:
    bench = Bench()
    bench.write_all({x.torque_enable: 1, x.bus_watchdog: 5, x.profile_velocity: 20, x.goal_position: 4000})
    bench.run(0.3)
    stopped = bench.read(x.present_position)
    assert bench.read(x.bus_watchdog) == 255
    bench.run(1.0)
    assert bench.read(x.present_position) == pytest.approx(stopped, abs=10)


def test_the_bus_watchdog_waits_for_the_torque() -> None:
    bench = Bench()
    bench.write_all({x.bus_watchdog: 5})
    bench.run(1.0)
    assert bench.read(x.bus_watchdog) == 5


def test_the_realtime_tick_counts_milliseconds_to_32767() -> None:
    bench = Bench()
    first = bench.read(x.realtime_tick)
    bench.run(0.5)
    assert bench.read(x.realtime_tick) - first == pytest.approx(500, abs=3)
    bench.run(32.768)
    assert bench.read(x.realtime_tick) - first == pytest.approx(500, abs=6)


@pytest.mark.parametrize(("threshold", "moving"), [(10, 1), (200, 0)])
def test_moving_compares_the_velocity_with_the_moving_threshold(threshold: int, moving: int) -> None:
    bench = Bench()
    bench.write_all({x.moving_threshold: threshold, x.operating_mode: PWM, x.torque_enable: 1, x.goal_pwm: 400})
    bench.run(0.5)
    assert 10 < bench.read(x.present_velocity) < 200
    assert bench.read(x.moving) == moving


def test_moving_is_1_while_a_profile_is_in_progress() -> None:
    bench = Bench()
    bench.write_all({x.moving_threshold: 500, x.torque_enable: 1, x.profile_velocity: 10, x.goal_position: 2300})
    bench.run(0.3)
    assert bench.read(x.moving) == 1
    bench.run(3.0)
    assert bench.read(x.moving) == 0


@pytest.mark.parametrize(
    ("velocity", "acceleration", "kind"), [(0, 0, 0), (30, 0, 1), (30, 2000, 3), (500, 5, 2)], ids=str
)
def test_the_moving_status_names_the_profile(velocity: int, acceleration: int, kind: int) -> None:
    bench = Bench()
    bench.write_all({
        x.profile_acceleration: acceleration, x.profile_velocity: velocity, x.torque_enable: 1, x.goal_position: 2600,
    })  # fmt: skip
    bench.run(0.1)
    status = bench.read(x.moving_status)
    assert status >> 4 == kind
    assert bool(status & 2) == (velocity > 0)
    assert not status & 1
    bench.run(6.0)
    assert bench.read(x.moving_status) & 3 == 1


def test_the_moving_status_reports_a_following_error() -> None:
    bench = Bench(load_nm=1.0)
    bench.write_all({x.goal_pwm: 100, x.torque_enable: 1})
    bench.run(0.5)
    assert bench.read(x.moving_status) & 9 == 8
