"""Power of a virtual line: servos report the voltage, are silent without power, and lose their RAM in a restart."""

import pytest

from drivers.bus.bus import Bus
from drivers.servos import sts, x
from drivers.types import ServoFault, ServoState
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.feetech import VirtualBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.line.power import BROWN_OUT_V, feed, restart, watch_supply
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.servos.sts.servo import REBOOT_S

IDS = (1, 2)


class Line:
    def __init__(self) -> None:
        self.clock = SimulatedClock()
        self.servos = VirtualBus.of(BenchPlant(IDS))
        self.bus = Bus(VirtualPort(self.servos, self.clock), self.clock)

    def wait(self, seconds: float) -> None:
        self.clock.sleep_until(self.clock.now() + seconds)
        self.servos.advance(self.clock.now())

    def silent(self) -> list[int]:
        return [i for i, reading in self.bus.read_states(IDS).items() if isinstance(reading, ServoFault)]


@pytest.mark.parametrize("voltage_v", [5.0, 9.5, 14.5])
def test_servos_report_their_supply_voltage(voltage_v: float) -> None:
    line = Line()
    feed(line.servos, voltage_v)
    line.wait(0.1)
    for reading in line.bus.read_states(IDS).values():
        assert isinstance(reading, ServoState)
        assert reading.voltage_v == pytest.approx(voltage_v, abs=0.06)


def test_servos_without_power_are_silent_until_they_have_restarted() -> None:
    line = Line()
    feed(line.servos, BROWN_OUT_V - 0.1)
    line.wait(5.0)
    assert line.silent() == list(IDS)
    feed(line.servos, 12.0)
    line.wait(0.5 * REBOOT_S)
    assert line.silent() == list(IDS)
    line.wait(REBOOT_S)
    assert line.silent() == []


def test_a_restart_resets_torque_and_limit_of_one_servo_only() -> None:
    line = Line()
    for servo_id in IDS:
        line.bus.write(servo_id, sts.torque_limit, 400)
        line.bus.write(servo_id, sts.torque_enable, 1)
    restart(line.servos.servo(2))
    line.wait(2.0 * REBOOT_S)
    held = {i: (line.bus.read(i, sts.torque_enable), line.bus.read(i, sts.torque_limit)) for i in IDS}
    assert held == {1: (1, 400), 2: (0, 1000)}


def test_a_dynamixel_without_power_ignores_packets_until_it_has_restarted() -> None:
    line = VirtualDynamixelBus.of(BenchPlant(IDS), dict.fromkeys(IDS, x.XL430_W250))
    servo = line.servo(1)
    feed(line, 0.0)
    assert servo.deaf
    line.advance(0.0)
    line.advance(5.0)
    assert servo.deaf
    feed(line)
    line.advance(5.0 + 1.1 * servo.BOOT_S)
    assert not servo.deaf


def test_a_supply_with_thin_leads_fails_only_under_load() -> None:
    line = Line()
    line.bus.write(1, sts.torque_enable, 1)
    line.bus.write(1, sts.goal_position, 4000)
    feed(line.servos, resistance_ohm=50.0)
    watch_supply(line.servos)
    assert line.silent() == []
    for _ in range(200):
        line.wait(0.001)
        watch_supply(line.servos)
    assert line.silent() == list(IDS)  # both servos have the same supply
