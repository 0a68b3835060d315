"""Gains that another program has left in the RAM of servos are corrected and reported when an arm is activated."""

import logging

import pytest

from drivers.bus.bus import Bus
from drivers.protocol import v1
from drivers.servos import ax_mx, x, xl320
from drivers.servos.catalog import MODELS, series_of
from drivers.servos.dynamixel import PROTOCOL_2
from drivers.servos.ram_gains import ram_gains
from drivers.servos.register import Register, ServoModel
from hal.joint import Joint
from hal.servos.activation import FRESH_S
from hal.servos.servo_gains import wanted_gains
from hal.servos.servo_hardware import ServoHardware
from hal.servos.servo_settings import mistakes
from hal.types import JointLimits
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.feetech import VirtualBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.servos.dynamixel.models import factory_of

LIMITS = JointLimits(-3.2, 3.2, 4.0, 12.0, 120.0)
GAIN = ax_mx.cw_compliance_slope
GRIPPER = Joint("gripper", 1, x.XL330_M288, LIMITS)


class Arm:
    """One limp joint whose servo has these gains in its RAM."""

    def __init__(self, joint: Joint, left: dict[Register, int]) -> None:
        clock, plant = SimulatedClock(5.0), BenchPlant((1,))
        plant.place([1.5])
        of = VirtualDynamixelBus.of if series_of(joint.model).protocol is PROTOCOL_2 else VirtualBus.of
        self.line = of(plant, {1: joint.model})
        self.memory = self.line.servo(1).memory
        for register, value in left.items():
            self.memory.put(register, value)
        self.clock, self.port = clock, VirtualPort(self.line, clock)
        bus = Bus(self.port, clock, {1: joint.model})
        self.hardware = ServoHardware("arm", [joint], lambda: bus, clock)

    def activated(self) -> "Arm":
        self.hardware.configure()
        self.hardware.activate()
        return self

    def held(self, *registers: Register) -> list[int]:
        return [self.memory.get(register) for register in registers]


@pytest.mark.parametrize(
    ("register", "left"),
    [
        (x.position_p_gain, 20),
        (x.position_d_gain, 600),
        (x.position_i_gain, 3000),
        (x.feedforward_1st_gain, 100),
        (x.feedforward_2nd_gain, 50),
    ],
)
def test_a_gain_that_another_program_has_left_is_replaced_and_named(
    register: Register, left: int, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        arm = Arm(GRIPPER, {register: left}).activated()
    right = ram_gains(GRIPPER.model)[register]
    assert arm.held(register) == [right]
    assert caplog.messages == [
        f"gripper (servo 1): another program has set different gains in the servo's RAM: {register.name} {left} (now "
        f"{right}). To keep a gain, write it in the robot file"
    ]


@pytest.mark.parametrize("joint", [GRIPPER, Joint("lift", 1, x.XL430_W250, LIMITS, position_p=2400)])
def test_factory_gains_are_not_reported(joint: Joint, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        arm = Arm(joint, {}).activated()
        arm.hardware.deactivate(relax=False)
        arm.hardware.activate()
    assert caplog.messages == []
    assert arm.held(*wanted_gains(joint)) == list(wanted_gains(joint).values())


def test_gains_of_the_robot_file_are_written(caplog: pytest.LogCaptureFixture) -> None:
    settings = {"position_d_gain": 600, "feedforward_1st_gain": 40, "pwm_limit": 443}
    assert mistakes(x.XL330_M288, settings) == []
    joint = Joint("gripper", 1, x.XL330_M288, LIMITS, position_p=900, settings=tuple(settings.items()))
    with caplog.at_level(logging.WARNING):
        arm = Arm(joint, {x.position_i_gain: 7}).activated()
    registers = (x.position_p_gain, x.position_i_gain, x.position_d_gain, x.feedforward_1st_gain, x.pwm_limit)
    assert arm.held(*registers) == [900, 0, 600, 40, 443]
    (said,) = caplog.messages
    assert "position_i_gain 7 (now 0)" in said and "position_d_gain" not in said


@pytest.mark.parametrize(
    ("model", "register", "right"),
    [
        (xl320.XL320, xl320.p_gain, 32),
        (ax_mx.MX_28, ax_mx.i_gain, 0),
        (ax_mx.AX_12A, ax_mx.cw_compliance_slope, 32),
    ],
)
def test_gains_of_the_other_dynamixels_are_replaced(model: ServoModel, register: Register, right: int) -> None:
    joint = Joint("joint", 1, model, JointLimits(-2.6, 2.6, 4.0, 12.0, 120.0), zero_counts=(model.last_count + 1) // 2)
    assert Arm(joint, {register: 5}).activated().held(register) == [right]


@pytest.mark.parametrize("lost", [1, 3])
def test_a_lost_reply_about_a_gain_does_not_make_the_measured_position_old(lost: int) -> None:
    """The joint is limp and may sink while requests for gains are repeated."""
    joint = Joint("joint", 1, ax_mx.AX_12A, JointLimits(-2.6, 2.6, 4.0, 12.0, 120.0), zero_counts=512)
    arm = Arm(joint, {})
    packets: list[tuple[float, int, int]] = []
    port = arm.port
    send = port.write

    def write(data: bytes) -> None:
        packets.append((arm.clock.now(), data[4], data[5]))
        gain_requests = [place for _, code, place in packets if (code, place) == (v1.READ, GAIN.address)]
        concerned = (data[4], data[5]) == (v1.READ, GAIN.address) and len(gain_requests) <= lost
        (arm.line.faults.silence if concerned else arm.line.faults.restore)(1)
        send(data)

    port.write = write  # type: ignore[method-assign]
    arm.activated()
    (switched_s,) = [at_s for at_s, *packet in packets if packet == [v1.WRITE, ax_mx.torque_enable.address]]
    measured = [at_s for at_s, *packet in packets if packet == [v1.READ, ax_mx.present_position.address]]
    assert switched_s - max(at_s for at_s in measured if at_s < switched_s) < FRESH_S
    assert arm.held(ax_mx.torque_enable) == [1]


def test_a_servo_that_loses_its_gains_gets_them_again() -> None:
    joint = Joint("lift", 1, x.XL430_W250, LIMITS, position_p=2400)
    arm = Arm(joint, {}).activated()
    arm.line.servo(1).power_cycle()
    arm.hardware.deactivate(relax=False)
    arm.hardware.activate()
    assert arm.held(x.position_p_gain, x.position_d_gain) == [2400, 4000]


UNREAD = {"xc335-t332"}
"""Models whose tables are not in the e-manual. The position gains of these models are unknown, so none of them is
written."""


@pytest.mark.parametrize("model", x.MODELS.values(), ids=lambda model: model.name)
def test_every_model_has_the_gains_of_its_virtual_servo(model: x.XModel) -> None:
    factory = factory_of(model)
    assert {register: factory.get(register, 0) for register in ram_gains(model)} == ram_gains(model)
    pid = {x.position_p_gain, x.position_i_gain, x.position_d_gain}
    assert ram_gains(model).keys() & pid == (set() if model.name in UNREAD else pid)


def test_gains_in_eeprom_are_left_to_the_settings() -> None:
    in_eeprom = [model for model in MODELS.values() if series_of(model).make == "feetech"]
    assert in_eeprom and not any(map(ram_gains, in_eeprom))
