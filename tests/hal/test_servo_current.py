"""Tests of the motor current in the state of servos that measure it."""

import math

import pytest

from drivers.bus.bus import Bus
from drivers.servos import sts
from drivers.servos import x as x_series
from hal.joint import Joint
from hal.servos.servo_hardware import ServoHardware
from hal.types import JointLimits
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.feetech import VirtualBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.mechanics.plant import BenchPlant

LIMITS = JointLimits(-3.2, 3.2, 4.0, 12.0, 120.0)


def test_current_has_the_joints_sign_or_is_nan() -> None:
    models = {1: x_series.XM430_W350, 2: x_series.XM430_W350, 3: x_series.XL430_W250}
    signs = {1: 1, 2: -1, 3: 1}
    clock, plant = SimulatedClock(20.0), BenchPlant(list(models))
    servos = VirtualDynamixelBus.of(plant, models)
    joints = [Joint(f"joint{i}", i, model, LIMITS, sign=signs[i]) for i, model in models.items()]
    hardware = ServoHardware("arm", joints, lambda: Bus(VirtualPort(servos, clock), clock, models), clock)
    hardware.configure()
    hardware.activate()
    plant.load_nm[:] = [-1.0, -1.0, -1.0]  # the load pulls backward, so the motors drive forward
    clock.sleep_until(clock.now() + 0.5)
    health = hardware.read().health
    for servo_id in (1, 2):
        current_a = servos.servo(servo_id).firmware.current_a
        assert current_a > 0.2
        assert health[f"joint{servo_id}"].current_a == pytest.approx(signs[servo_id] * current_a, abs=0.00269)
    assert math.isnan(health["joint3"].current_a)


def test_a_cycle_does_not_read_the_current_of_a_feetech_servo() -> None:
    clock = SimulatedClock(20.0)
    servos = VirtualBus.of(BenchPlant([1]))
    joints = [Joint("joint1", 1, sts.STS3215, LIMITS)]
    models = {1: sts.STS3215}
    hardware = ServoHardware("arm", joints, lambda: Bus(VirtualPort(servos, clock), clock, models), clock)
    hardware.configure()
    assert math.isnan(hardware.read().health["joint1"].current_a)
