"""All instructions to a single servo, for every make."""

import pytest

from drivers.driver_errors import DriverError, ServoRefused, ServoSilent
from drivers.servos import ax_mx as dxl
from drivers.servos.catalog import series_of
from tests.drivers.test_single_calls import Bench, Case, every_case

HALF = 500
"""Share of full torque, which corresponds to a different number of steps in every series."""
DEAF_S = 1.0
"""Maximum time of a reboot, in seconds."""


@every_case
def test_a_ping_is_answered_or_not(case: Case) -> None:
    bench = Bench(case)
    bench.bus.ping(1)
    bench.servos.faults.silence(1)
    with pytest.raises(ServoSilent, match="servo 1"):
        bench.bus.ping(1)


@every_case
def test_a_reg_write_takes_effect_at_the_action(case: Case) -> None:
    bench = Bench(case)
    goal = series_of(case.model).goal_position
    before = bench.held(goal)
    bench.bus.reg_write(1, goal, 700)
    assert bench.held(goal) == before != 700
    bench.bus.action()
    bench.clock.sleep_until(bench.clock.now() + 0.001)
    assert bench.bus.read(1, goal) == 700


@every_case
def test_a_reboot_disables_torque_and_the_servo_returns_soon(case: Case) -> None:
    bench = Bench(case)
    bench.bus.torque_on(1)
    if case.model is dxl.AX_12A:
        with pytest.raises(ServoRefused, match="servo 1: cannot be rebooted over the bus"):
            bench.bus.reboot(1)
        assert bench.bus.torque_is_on(1)
        return
    bench.bus.reboot(1)
    with pytest.raises(ServoSilent):
        bench.bus.ping(1)
    bench.clock.sleep_until(bench.clock.now() + DEAF_S)
    assert not bench.bus.torque_is_on(1)


@every_case
def test_a_factory_reset_restores_the_settings(case: Case) -> None:
    bench = Bench(case)
    register, value = series_of(case.model).max_torque, HALF
    factory = bench.held(register)
    bench.servos.servo(1).memory.put(register, value)
    bench.bus.factory_reset(1)
    bench.clock.sleep_until(bench.clock.now() + DEAF_S)
    assert bench.bus.read(1, register) == factory != value


@every_case
def test_a_broadcast_ping_finds_all_servos(case: Case) -> None:
    bench = Bench(case)
    if series_of(case.model).protocol.name == "Dynamixel protocol 2.0":
        assert bench.bus.broadcast_ping() == (1,)
        bench.servos.faults.silence(1)
        assert bench.bus.broadcast_ping() == ()
    else:
        with pytest.raises(DriverError, match="ping each ID separately"):
            bench.bus.broadcast_ping()
