"""Tests of servolab on virtual servos, as in its lessons."""

import importlib
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from tests.peers.conftest import Serve
from tests.peers.waiting import eventually

pytestmark = pytest.mark.slow

# Import by name, because the module has no types.
servolab: Any = importlib.import_module("servolab")


@pytest.fixture
def bus(serve: Serve) -> Iterator[Any]:
    bus = servolab.connect(serve("sts3215", 1, 2, 3), scan=False)
    eventually(lambda: bus.scan(range(1, 6)) == [1, 2, 3])
    yield bus
    bus.disconnect()


def test_the_motors_and_their_states_are_found(bus: Any) -> None:
    assert [motor.model for motor in bus.motors.values()] == ["STS3215"] * 3
    feedback = bus.read_feedback()
    assert feedback.ids == [1, 2, 3]
    np.testing.assert_allclose(feedback.position, 0.0, atol=0.005)
    np.testing.assert_allclose(feedback.voltage, 12.0, atol=0.1)
    assert feedback.status == [[], [], []]


def test_one_servo_and_several_servos_are_moved(bus: Any) -> None:
    bus[1].move_to(0.5, speed=3.0, wait=True)
    assert bus[1].position == pytest.approx(0.5, abs=0.02)
    for servo_id in (1, 2, 3):
        bus[servo_id].torque_enabled = True
    bus.move_to([0.3, -0.3, 0.1], speed=3.0, acceleration=20.0, wait=True)
    np.testing.assert_allclose(bus.read_feedback().position, [0.3, -0.3, 0.1], atol=0.02)


def test_speed_and_pwm_modes_turn_the_shaft(bus: Any) -> None:
    motor = bus[2]
    motor.mode = "velocity"
    motor.torque_enabled = True
    motor.velocity = 1.5
    time.sleep(0.6)
    eventually(lambda: abs(motor.velocity - 1.5) < 0.2, 5.0)
    motor.velocity = 0.0
    motor.mode = "pwm"
    motor.torque_enabled = True
    motor.pwm = 0.4
    eventually(lambda: abs(motor.velocity) > 1.0, 5.0)
    motor.mode = "position"
    assert motor.torque_enabled is False


def test_zero_gains_and_id_are_kept(bus: Any) -> None:
    motor = bus[3]
    motor.move_to(0.4, wait=True)
    motor.set_zero()
    eventually(
        lambda: motor.position == pytest.approx(0.0, abs=0.01)
    )  # the servo updates its position every millisecond
    motor.pid = (20, 0, 16)
    assert tuple(motor.pid) == (20, 0, 16)
    motor.id = 9
    assert bus[9].read_register("id") == 9


def test_disconnecting_releases_all_servos(bus: Any) -> None:
    bus[1].torque_enabled = True
    bus.torque_off_all()
    assert not bus[1].torque_enabled
