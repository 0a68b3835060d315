"""Protections of a virtual STS servo, and the conditions that end them."""

import pytest

from drivers.servos import sts
from drivers.servos.register import Register
from sim_backend.line.rig import Supply
from sim_backend.packets.sts import status_packet
from tests.sim_backend.sts_bench import StsBench

VOLTAGE, TEMPERATURE, CURRENT, OVERLOAD = 1 << 0, 1 << 2, 1 << 3, 1 << 5


def _bench(**registers: int) -> StsBench:
    """Return a servo, by default without a current limit, because the current limit would act at the same time as the
    overload protection."""
    bench = StsBench()
    for name, value in {"protection_current": 0, **registers}.items():
        register: Register = getattr(sts, name)
        bench[register] = value
    bench.run(0.001)
    return bench


def _stalled(seconds: float = 2.5, **registers: int) -> StsBench:
    """Return a servo that is blocked on its way to a goal."""
    bench = _bench(**registers)
    bench.go(2400)
    bench.held_at(2048, seconds)
    return bench


# Overload


def test_a_stall_leads_to_the_protective_torque_after_the_protection_time() -> None:
    bench = _stalled(2.0)
    assert (bench[sts.status], bench[sts.present_load]) == (0, -1000)
    bench.held_at(2048, 0.2)
    assert (bench[sts.status], bench[sts.present_load]) == (OVERLOAD, -200)
    assert bench.servo.read_status(0, 1) == status_packet(1, OVERLOAD, b"\x03")
    assert bench[sts.torque_enable] == 1


def test_the_same_goal_or_torque_on_does_not_end_an_overload() -> None:
    bench = _stalled()
    for register, value in ((sts.goal_position, 2400), (sts.torque_enable, 1)):
        bench[register] = value
        bench.held_at(2048, 0.1)
        assert bench[sts.status] == OVERLOAD


@pytest.mark.parametrize("goal", [2060, 1000])
def test_a_goal_near_the_shaft_or_on_its_other_side_ends_an_overload(goal: int) -> None:
    bench = _stalled()
    bench[sts.goal_position] = goal
    bench.held_at(2048, 0.4)
    assert bench[sts.status] == 0


def test_torque_off_or_a_free_shaft_ends_an_overload() -> None:
    bench = _stalled()
    bench[sts.torque_enable] = 0
    bench.held_at(2048, 0.002)
    assert bench[sts.status] == 0
    bench = _stalled()
    bench.run(2.0)
    assert bench[sts.status] == 0
    assert bench[sts.present_position] == pytest.approx(2400, abs=3)


def test_a_moving_servo_never_overloads() -> None:
    bench = _bench(max_position=0)
    bench.go(20000)
    for ms in range(5000):
        bench.turn_to(2048 + ms * 0.2)
        bench.rig.step()
    assert (bench[sts.status], bench[sts.present_load]) == (0, -1000)


@pytest.mark.parametrize(("counts", "status"), [(48, OVERLOAD), (56, 0)])
def test_a_motion_of_fifty_counts_restarts_the_overload_timer(counts: int, status: int) -> None:
    bench = _bench()
    bench.go(2600)
    bench.held_at(2048, 1.0)
    for moved in range(counts):
        bench.held_at(2048 + moved, 0.001)
    bench.held_at(2048 + counts, 1.1)
    assert bench[sts.status] == status


def test_the_overload_timer_continues_below_the_overload_torque() -> None:
    """The timer starts above 80 %, continues at 50 %, and stops only below the protective torque."""
    bench = _bench()
    bench.go(2200)
    bench.held_at(2048, 0.4)
    assert bench[sts.present_load] == -1000
    bench.go(2110)
    bench.held_at(2048, 1.0)
    assert -560 < bench[sts.present_load] < -440
    assert bench[sts.status] == 0
    bench.held_at(2048, 1.0)
    assert bench[sts.status] == OVERLOAD
    calm = _bench()
    calm.go(2110)
    calm.held_at(2048, 4.0)
    assert calm[sts.status] == 0


def test_a_torque_limit_below_the_overload_torque_never_overloads() -> None:
    assert _stalled(5.0, torque_limit=790)[sts.status] == 0


def test_pwm_mode_reports_an_overload_and_keeps_driving() -> None:
    bench = _bench(operating_mode=2)
    bench[sts.goal_time] = 900
    bench.held_at(2048, 2.5)
    assert (bench[sts.status], bench[sts.present_load]) == (OVERLOAD, 900)


def test_errors_outside_the_unloading_condition_are_only_reported() -> None:
    bench = _stalled(unloading_condition=0)
    assert (bench[sts.status], bench[sts.present_load]) == (OVERLOAD, -1000)


# Over-current


def test_overcurrent_switches_the_torque_off_in_register_40() -> None:
    bench = _stalled(2.2, protection_current=310, overload_torque=100)
    assert bench[sts.status] == CURRENT
    assert (bench[sts.torque_enable], bench[sts.present_load], bench[sts.present_current]) == (0, 0, 0)


def test_the_next_goal_enables_the_torque_after_an_overcurrent() -> None:
    bench = _stalled(2.2, protection_current=310, overload_torque=100)
    bench.go(2148)
    assert (bench[sts.status], bench[sts.torque_enable]) == (0, 1)
    bench.run(1.0)
    assert bench[sts.present_position] == pytest.approx(2148, abs=3)


@pytest.mark.parametrize("off", ["protection_current", "overcurrent_time"])
def test_a_limit_or_time_of_0_disables_the_current_limit(off: str) -> None:
    registers = {"protection_current": 310, "overcurrent_time": 200, off: 0}
    assert _stalled(5.0, overload_torque=100, **registers)[sts.status] == 0


def test_an_overcurrent_that_is_only_reported_ends_with_the_current() -> None:
    bench = _stalled(2.2, protection_current=310, overload_torque=100, unloading_condition=0)
    assert (bench[sts.status], bench[sts.torque_enable]) == (CURRENT, 1)
    bench.go(2060)
    bench.held_at(2048, 0.4)
    assert bench[sts.status] == 0


# Voltage and heat


def test_undervoltage_is_reported_at_once_and_overvoltage_after_51_ms() -> None:
    bench = _bench(min_voltage=125)
    assert bench[sts.status] == VOLTAGE
    bench[sts.min_voltage] = 40
    bench.run(0.001)
    assert bench[sts.status] == 0
    bench[sts.max_voltage] = 110
    bench.run(0.050)
    assert bench[sts.status] == 0
    bench.run(0.001)
    assert bench[sts.status] == VOLTAGE


def test_overheating_shorts_the_motor_and_the_servo_stays_where_it_sank() -> None:
    bench = StsBench(load_nm=-0.3)
    bench.go(2048)
    bench.run(0.3)
    bench[sts.max_temperature] = 20
    bench.run(1.0)
    assert (bench[sts.status], bench[sts.torque_enable], bench[sts.present_load]) == (TEMPERATURE, 1, 0)
    sunk = bench[sts.present_position]
    assert sunk < 2000
    assert abs(bench.plant.velocities()[0]) < 1.0  # a free shaft would already turn at 8 rad/s
    bench[sts.max_temperature] = 32
    bench.run(1.0)
    assert bench[sts.status] == TEMPERATURE  # 27 degrees are exactly 5 below the limit, and a restart needs more
    bench[sts.max_temperature] = 33
    sunk = bench[sts.present_position]
    bench.run(1.0)
    assert bench[sts.status] == 0
    assert bench[sts.present_position] == pytest.approx(sunk, abs=40)


def test_a_voltage_error_in_the_mask_sets_the_goal_to_the_shaft() -> None:
    bench = _bench(unloading_condition=VOLTAGE)
    bench.go(3000)
    bench.run(0.15)
    bench[sts.min_voltage] = 125
    bench.run(0.3)
    stopped = bench[sts.present_position]
    assert stopped < 2900
    bench[sts.min_voltage] = 40
    bench.run(1.0)
    assert bench[sts.present_position] == pytest.approx(stopped, abs=3)


def test_a_supply_sags_under_load() -> None:
    bench = StsBench(supply=Supply(12.0, 0.5))
    bench.go(2400)
    bench.held_at(2048, 0.5)
    assert bench[sts.present_voltage] in range(106, 110)


def test_a_stalled_motor_heats_up_according_to_its_constants() -> None:
    """A published test shows about 15 K after ten minutes at half the stall torque."""
    bench = StsBench(load_nm=-1.47)
    bench.go(2048)
    bench.run(600.0)
    assert bench[sts.present_temperature] - 27 == pytest.approx(15, abs=3)
