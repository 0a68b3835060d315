"""A register of one servo, written without a reply and read before a deadline, on virtual servos."""

import math

import pytest

from drivers.bus.bus import Bus
from drivers.servos import x
from drivers.servos.catalog import MODELS
from drivers.servos.register import Register
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.mechanics.plant import BenchPlant

MODEL = MODELS["xm540-w270"]


@pytest.fixture
def bus() -> Bus:
    clock = SimulatedClock()
    virtual = VirtualDynamixelBus.of(BenchPlant((1, 2)), {1: MODEL, 2: MODEL})
    return Bus(VirtualPort(virtual, clock), clock, {1: MODEL, 2: MODEL})


@pytest.mark.parametrize(("register", "value"), [(x.led, 1), (x.external_port_data_2, 1)])
def test_a_value_reaches_only_its_servo(bus: Bus, register: Register, value: int) -> None:
    bus.write_unacknowledged(1, register, value)
    found = bus.read_registers({1: register, 2: register}, math.inf)
    assert found == {1: value, 2: 0}
    assert bus.read(1, register) == value


def test_a_silent_servo_is_missing(bus: Bus) -> None:
    assert bus.read_registers({9: x.external_port_data_1}, 0.02) == {}


def test_a_value_that_the_servo_would_refuse_is_not_sent(bus: Bus) -> None:
    with pytest.raises(ValueError, match="led must be 0 to 1, not 2"):
        bus.write_unacknowledged(1, x.led, 2)
    assert bus.read(1, x.led) == 0
