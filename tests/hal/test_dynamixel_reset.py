"""Tests that a Dynamixel that was reset by a supply dip is not mistaken for a servo with torque."""

import re

import pytest

from drivers.bus.bus import Bus
from drivers.driver_errors import ServoRefused
from drivers.servos import x as x_series
from hal.joint import Joint
from hal.lifecycle import LifecycleState
from hal.servos.servo_hardware import ServoHardware
from hal.types import JointLimits
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.mechanics.plant import BenchPlant
from tests.hal.faults import fault_texts

MODELS = {1: x_series.XM430_W350, 2: x_series.XL430_W250}
JOINTS = [
    Joint(name, servo_id, model, JointLimits(-3.2, 3.2, 4.0, 12.0, 120.0))
    for name, (servo_id, model) in zip(("shoulder", "elbow"), MODELS.items(), strict=True)
]


@pytest.mark.parametrize("victim", JOINTS, ids=lambda joint: joint.name)
def test_a_servo_that_has_shut_down_is_reported_to_need_a_reboot(victim: Joint) -> None:
    clock = SimulatedClock(20.0)
    servos = VirtualDynamixelBus.of(BenchPlant(list(MODELS)), MODELS)
    hardware = ServoHardware("arm", JOINTS, lambda: Bus(VirtualPort(servos, clock), clock, MODELS), clock)
    hardware.configure()
    hardware.activate()
    protection = servos.servo(victim.servo_id).firmware.protection
    protection.status, protection.released = 1 << 5, True
    remedy = r"\(overload alarm\): reboot it \(servoloop reboot\), then activate again"
    for _ in range(12):
        clock.sleep_until(clock.now() + 0.05)
        faults = fault_texts(hardware.read())
    assert re.search(rf"{victim.name}: servo {victim.servo_id} has lost its torque {remedy}", faults[victim.name])
    hardware.deactivate(relax=False)
    with pytest.raises(ServoRefused, match=rf"servo {victim.servo_id}: refuses to enable torque {remedy}"):
        hardware.activate()


@pytest.mark.parametrize("victim", JOINTS, ids=lambda joint: joint.name)
def test_a_reset_servo_is_reported_checked_and_can_be_activated_again(victim: Joint) -> None:
    clock = SimulatedClock(20.0)
    servos = VirtualDynamixelBus.of(BenchPlant(list(MODELS)), MODELS)
    hardware = ServoHardware("arm", JOINTS, lambda: Bus(VirtualPort(servos, clock), clock, MODELS), clock)
    hardware.configure()
    hardware.activate()

    def faults() -> dict[str, str]:
        clock.sleep_until(clock.now() + 0.05)
        return fault_texts(hardware.read())

    called = f"{victim.name}: servo {victim.servo_id}"
    assert faults() == {}
    servos.servo(victim.servo_id).power_cycle()
    (text,) = faults().values()
    assert text.startswith(f"{called} has lost the mapping of its indirect registers")
    for _ in range(20):
        assert faults() == {victim.name: f"{called} returned with its torque disabled (power dip?): activate again"}
    assert hardware.state is LifecycleState.ACTIVE
    hardware.deactivate(relax=False)
    hardware.activate()
    assert faults() == {}
    assert servos.servo(victim.servo_id).memory.get(x_series.torque_enable) == 1


def test_a_refused_torque_is_reported_with_all_alarms() -> None:
    clock = SimulatedClock(20.0)
    servos = VirtualDynamixelBus.of(BenchPlant(list(MODELS)), MODELS)
    hardware = ServoHardware("arm", JOINTS, lambda: Bus(VirtualPort(servos, clock), clock, MODELS), clock)
    hardware.configure()
    protection = servos.servo(2).firmware.protection
    protection.status, protection.released = 1 << 5 | 1 << 2, True
    with pytest.raises(
        ServoRefused, match=r"servo 2: refuses to enable torque \(temperature, overload alarm\): reboot it"
    ):
        hardware.activate()
